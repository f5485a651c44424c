/* The detections of a cycle: as the functions of the same names in sweeps.py. */
enum { STANDS, MOVES, BESIDE, UNASKED };

/* Of points, `count` of them at `some`, so many of which move: marks those that at least two of these lie close to. */
static void mark_beside(const void *points, Py_ssize_t stride, const double *movers, Py_ssize_t moving, double radius, Py_ssize_t begin, Py_ssize_t end,
                        const uint8_t *asked, uint8_t mark, uint8_t other, uint8_t *out) {
    double square = radius * radius;
    for (Py_ssize_t n = begin; n < end; n++) {
        if (asked && !asked[n]) continue;
        const double *point = (const double *)((const char *)points + n * stride);
        int near = 0;
        for (Py_ssize_t m = 0; m < moving; m++) {
            double dx = point[0] - movers[2 * m], dy = point[1] - movers[2 * m + 1];
            near += dx * dx + dy * dy < square;
        }
        out[n] = near >= 2 ? mark : other;
    }
}

KERNEL(standing) {
    TAKE("d1d1d1l1d1xxxB1!");
    Py_ssize_t size = LENGTH(0, 0), scans = LENGTH(3, 0);
    int fits = LENGTH(1, 0) == size && LENGTH(2, 0) == size && LENGTH(4, 0) == size && LENGTH(5, 0) == size;
    if (!sized(&given, fits && sizes_fit(&given, 3, scans, size))) return NULL;
    const double *range = ARRAY(0)->buf, *cos = ARRAY(1)->buf, *sin = ARRAY(2)->buf, *sigmas = ARRAY(4)->buf, limit = given.number[0];
    const int64_t *sizes = ARRAY(3)->buf;
    uint8_t *out = ARRAY(5)->buf;
    double *points = malloc((4 * size + 1) * sizeof *points), *movers = points + 2 * size;
    if (points == NULL) {
        drop(&given);
        return PyErr_NoMemory();
    }
    for (Py_ssize_t s = 0, begin = 0; s < scans; begin += sizes[s++]) {
        Py_ssize_t moving = 0, end = begin + sizes[s];
        for (Py_ssize_t n = begin; n < end; n++) {
            points[2 * n] = range[n] * cos[n];
            points[2 * n + 1] = range[n] * sin[n];
            if (sigmas[n] > limit) memcpy(movers + 2 * moving++, points + 2 * n, 2 * sizeof *movers);
        }
        mark_beside(points, 2 * sizeof *points, movers, moving, given.number[1], begin, end, NULL, 0, 1, out);
        for (Py_ssize_t n = begin; n < end; n++) out[n] &= !(sigmas[n] > limit) & (range[n] > given.number[2]);
    }
    free(points);
    return done(&given);
}

/* Columns of a scan's row: as Scan. */
enum { SENSOR_X, SENSOR_Y, SENSOR_YAW, RANGE, HALF_FOV, SPEED, YAW_RATE, AMBIGUITY, TURNING, CAR_X, CAR_Y, CAR_YAW, SCAN_VALUES };

KERNEL(gathered) {
    TAKE("*d1d2d2!l1!B1!");
    const List *list = &given.list[0];
    Py_ssize_t scans = LENGTH(0, 0), size = LENGTH(2, 0), n = 0;
    int fits = LENGTH(0, 1) == SCAN_VALUES && list->count == 4 * scans && LENGTH(1, 0) == 5 && LENGTH(1, 1) == size && LENGTH(3, 0) == size;
    for (Py_ssize_t k = 0; fits && k < 4 * scans; k++) {
        fits = list->array[k].shape[0] == list->array[k & ~3].shape[0];
        n += k & 3 ? 0 : list->array[k].shape[0];
    }
    if (!sized(&given, fits && n == size)) return NULL;
    double *azimuth = ROW(double, 1, 0), *bearing = ROW(double, 1, 1), *range = ROW(double, 1, 2), *rate = ROW(double, 1, 3), *rcs = ROW(double, 1, 4);
    int64_t *scan = ARRAY(2)->buf;
    uint8_t *near = ARRAY(3)->buf;
    n = 0;
    for (Py_ssize_t s = 0; s < scans; s++) {
        const double *of[4], *row = ROW(double, 0, s);
        for (int q = 0; q < 4; q++) of[q] = list->array[4 * s + q].buf;
        for (Py_ssize_t k = 0; k < list->array[4 * s].shape[0]; k++, n++) {
            range[n] = of[0][k];
            azimuth[n] = of[1][k];
            rate[n] = of[2][k];
            rcs[n] = of[3][k];
            bearing[n] = azimuth[n] + row[SENSOR_YAW];
            near[n] = range[n] <= row[RANGE];
            scan[n] = s;
        }
    }
    return done(&given);
}

KERNEL(deviations) {
    TAKE("d1d1d1B1l1d2xxxxd1!l2!");
    Py_ssize_t size = LENGTH(0, 0), scans = LENGTH(5, 0);
    int fits = LENGTH(5, 1) == SCAN_VALUES && LENGTH(6, 0) == size && LENGTH(7, 0) == 2 && LENGTH(7, 1) == scans && sizes_fit(&given, 4, scans, size);
    for (int n = 1; n < 4; n++) fits &= LENGTH(n, 0) == size;
    if (!sized(&given, fits)) return NULL;
    const double *cos = ARRAY(0)->buf, *sin = ARRAY(1)->buf, *rate = ARRAY(2)->buf;
    const uint8_t *near = ARRAY(3)->buf;
    const int64_t *sizes = ARRAY(4)->buf;
    double *out = ARRAY(6)->buf, by_rate = given.number[0], by_azimuth = given.number[1], by_speed = given.number[2], limit = given.number[3];
    int64_t *asked = ROW(int64_t, 7, 0), *standing = ROW(int64_t, 7, 1);
    for (Py_ssize_t s = 0, n = 0; s < scans; s++) {
        const double *scan = ROW(double, 5, s);
        double vx = scan[SPEED] - scan[YAW_RATE] * scan[SENSOR_Y], vy = scan[YAW_RATE] * scan[SENSOR_X];
        double interval = scan[AMBIGUITY], turning = scan[TURNING];
        asked[s] = standing[s] = 0;
        for (Py_ssize_t end = n + sizes[s]; n < end; n++) {
            double expected = -(vx * cos[n] + vy * sin[n]), left = rate[n] - expected;
            if (interval > 0) left -= interval * rint(left / interval);
            double azimuth = (vx * sin[n] - vy * cos[n]) * by_azimuth, speed = expected * by_speed;
            out[n] = fabs(left) / sqrt(by_rate * by_rate + azimuth * azimuth + speed * speed + turning * turning);
            asked[s] += near[n] != 0;
            standing[s] += near[n] && out[n] <= limit;
        }
    }
    return done(&given);
}

/* A pose of the plane: metres and radians. */
typedef struct {
    double x, y, yaw;
} Pose;

static Pose joined(Pose a_from_b, const double *b_from_c) {
    double c = cos(a_from_b.yaw), s = sin(a_from_b.yaw);
    return (Pose){a_from_b.x + c * b_from_c[0] - s * b_from_c[1], a_from_b.y + s * b_from_c[0] + c * b_from_c[1], a_from_b.yaw + b_from_c[2]};
}

/* b_from_a. */
static Pose inverse(Pose pose) {
    double c = cos(pose.yaw), s = sin(pose.yaw);
    return (Pose){-c * pose.x - s * pose.y, s * pose.x - c * pose.y, -pose.yaw};
}

KERNEL(sensors) {
    TAKE("d2xxxd2!d2!");
    Py_ssize_t scans = LENGTH(0, 0);
    if (!sized(&given, LENGTH(0, 1) == SCAN_VALUES && LENGTH(1, 0) == scans && LENGTH(1, 1) == 4 && LENGTH(2, 0) == scans && LENGTH(2, 1) == 3))
        return NULL;
    double x = given.number[0], y = given.number[1], yaw = given.number[2], c = cos(yaw), s = sin(yaw);
    const Pose base_from_odom = inverse((Pose){x, y, yaw});
    for (Py_ssize_t n = 0; n < scans; n++) {
        const double *scan = ROW(double, 0, n);
        double *in_base = ROW(double, 1, n), *in_odom = ROW(double, 2, n);
        Pose there = joined(joined(base_from_odom, scan + CAR_X), scan + SENSOR_X);
        in_base[0] = there.x;
        in_base[1] = there.y;
        in_base[2] = cos(there.yaw);
        in_base[3] = sin(there.yaw);
        in_odom[0] = c * there.x - s * there.y + x;
        in_odom[1] = s * there.x + c * there.y + y;
        in_odom[2] = there.yaw + yaw;
    }
    return done(&given);
}

KERNEL(recalled) {
    TAKE("d2d2d1d1d2xxxxd3!d1!l1!d2!");
    Py_ssize_t size = LENGTH(0, 0), scans = LENGTH(4, 0);
    if (!sized(&given, LENGTH(0, 1) == 2 && LENGTH(1, 0) == size && LENGTH(1, 1) == 2 && LENGTH(2, 0) == size && LENGTH(3, 0) == size && LENGTH(4, 1) == 3 &&
                           LENGTH(5, 0) == 2 && LENGTH(5, 1) == size && LENGTH(5, 2) == 2 && LENGTH(6, 0) == size && LENGTH(7, 0) == size &&
                           LENGTH(8, 0) == scans && LENGTH(8, 1) == 3))
        return NULL;
    const Pose base_from_odom = inverse((Pose){given.number[0], given.number[1], given.number[2]});
    const double *travelled = ARRAY(2)->buf, *update = ARRAY(3)->buf, distance = given.number[3];
    double *age = ARRAY(6)->buf, c = cos(base_from_odom.yaw), s = sin(base_from_odom.yaw), x = base_from_odom.x, y = base_from_odom.y;
    int64_t *numbers = ARRAY(7)->buf;
    for (int k = 0; k < 2; k++)
        for (Py_ssize_t n = 0; n < size; n++) {
            const double *there = ROW(double, k, n);
            double *here = ROW3(double, 5, k, n);
            here[0] = c * there[0] - s * there[1] + x;
            here[1] = s * there[0] + c * there[1] + y;
        }
    for (Py_ssize_t n = 0; n < size; n++) {
        age[n] = distance - travelled[n];
        numbers[n] = (int64_t)update[n];
    }
    for (Py_ssize_t n = 0; n < scans; n++) {
        const double *there = ROW(double, 4, n);
        double *here = ROW(double, 8, n);
        here[0] = c * there[0] - s * there[1] + x;
        here[1] = s * there[0] + c * there[1] + y;
        here[2] = there[2] + base_from_odom.yaw;
    }
    return done(&given);
}

KERNEL(placed) {
    TAKE("d1d1d1l1d2d2xxxd2!");
    Py_ssize_t size = LENGTH(0, 0), scans = LENGTH(4, 0);
    if (!sized(&given, LENGTH(1, 0) == size && LENGTH(2, 0) == size && LENGTH(4, 1) == 4 && LENGTH(5, 0) == scans && LENGTH(5, 1) == 3 &&
                           LENGTH(6, 0) == size && LENGTH(6, 1) == 6 && sizes_fit(&given, 3, scans, size)))
        return NULL;
    const double *range = ARRAY(0)->buf, *cosine = ARRAY(1)->buf, *sine = ARRAY(2)->buf;
    const int64_t *sizes = ARRAY(3)->buf;
    double x = given.number[0], y = given.number[1], c = cos(given.number[2]), s = sin(given.number[2]);
    for (Py_ssize_t k = 0, n = 0; k < scans; k++) {
        const double *in_base = ROW(double, 4, k), *in_odom = ROW(double, 5, k);
        for (Py_ssize_t end = n + sizes[k]; n < end; n++) {
            double along = range[n] * cosine[n], aside = range[n] * sine[n], *to = ROW(double, 6, n);
            to[0] = in_base[2] * along - in_base[3] * aside + in_base[0];
            to[1] = in_base[3] * along + in_base[2] * aside + in_base[1];
            to[2] = c * to[0] - s * to[1] + x;
            to[3] = s * to[0] + c * to[1] + y;
            to[4] = in_odom[0];
            to[5] = in_odom[1];
        }
    }
    return done(&given);
}

KERNEL(gated) {
    TAKE("d2d1B1d1xxxB1!l2!");
    Py_ssize_t size = LENGTH(0, 0);
    if (!sized(&given, LENGTH(0, 1) == 2 && LENGTH(1, 0) == size && LENGTH(2, 0) == size && LENGTH(3, 0) == size && LENGTH(4, 0) == size &&
                           LENGTH(5, 0) == 2 && LENGTH(5, 1) == size + 1))
        return NULL;
    const double *sigmas = ARRAY(1)->buf, *range = ARRAY(3)->buf, reach = given.number[0], limit = given.number[1];
    const uint8_t *near = ARRAY(2)->buf;
    uint8_t *verdicts = ARRAY(4)->buf;
    double *movers = malloc((2 * size + 1) * sizeof *movers + size);
    if (movers == NULL) {
        drop(&given);
        return PyErr_NoMemory();
    }
    uint8_t *reached = (uint8_t *)(movers + 2 * size + 1);
    int alike = 1;
    for (Py_ssize_t n = 0; n < size; n++) {
        reached[n] = range[n] <= reach;
        alike &= reached[n] == (near[n] != 0);
    }
    for (int turn = alike ? 0 : 1; turn >= 0; turn--) {
        const uint8_t *asked = turn ? reached : near;
        int64_t *standing = ROW(int64_t, 5, turn);
        Py_ssize_t moving = 0, stand = 0;
        for (Py_ssize_t n = 0; n < size; n++)
            if (asked[n] && !(sigmas[n] <= limit)) memcpy(movers + 2 * moving++, ROW(double, 0, n), 2 * sizeof *movers);
        for (Py_ssize_t n = 0; n < size; n++) verdicts[n] = UNASKED;
        mark_beside(ARRAY(0)->buf, ARRAY(0)->strides[0], movers, moving, given.number[2], 0, size, asked, BESIDE, STANDS, verdicts);
        for (Py_ssize_t n = 0; n < size; n++) {
            if (asked[n] && !(sigmas[n] <= limit)) verdicts[n] = MOVES;
            if (verdicts[n] == STANDS) standing[++stand] = n;
        }
        standing[0] = stand;
    }
    if (alike) memcpy(ROW(int64_t, 5, 1), ROW(int64_t, 5, 0), (*ROW(int64_t, 5, 0) + 1) * sizeof(int64_t));
    free(movers);
    return done(&given);
}

enum { LEANINGS = 7 };

KERNEL(leanings) {
    TAKE("d1d1d1d1xxxxxxxxxxd2xxxxxxxd2!d1!d1!");
    Py_ssize_t size = LENGTH(0, 0), standing = 0;
    int fits = LENGTH(4, 0) == LEANINGS && LENGTH(4, 1) == LEANINGS && LENGTH(5, 0) == size && LENGTH(5, 1) == LEANINGS && LENGTH(6, 0) == size && LENGTH(7, 0) == size;
    for (int n = 1; n < 4; n++) fits &= LENGTH(n, 0) == size;
    if (!sized(&given, fits)) return NULL;
    const double *cos = ARRAY(0)->buf, *sin = ARRAY(1)->buf, *azimuth = ARRAY(2)->buf, *rate = ARRAY(3)->buf, *number = given.number;
    const double x = number[0], y = number[1], wheels = number[2], gyro = number[3], speed = number[4], yaw_rate = number[5];
    const double acceleration = number[6], turn_acceleration = number[7], too_high = number[8], interval = number[9];
    const double by_rate = number[10], by_azimuth = number[11], by_distortion = number[12], limit = number[13], worth = number[14], most = number[15];
    double *left = ARRAY(6)->buf, *weight = ARRAY(7)->buf;
    for (Py_ssize_t n = 0; n < size; n++) {
        double *slope = ROW(double, 5, n), lever = y * cos[n] - x * sin[n], by_bearing = speed * sin[n] - yaw_rate * (y * sin[n] + x * cos[n]);
        slope[0] = cos[n] * -wheels;
        slope[1] = -lever;
        slope[2] = lever * gyro;
        slope[3] = lever * turn_acceleration - cos[n] * acceleration;
        slope[4] = by_bearing;
        slope[5] = by_bearing * azimuth[n];
        slope[6] = 1;
        left[n] = rate[n] - (yaw_rate * lever - speed * cos[n] + too_high);
        if (interval > 0) left[n] -= interval * rint(left[n] / interval);
        double variance = by_rate * by_rate + (by_bearing * by_azimuth) * (by_bearing * by_azimuth), doubt = 0;
        for (int j = 0; j < LEANINGS; j++) {
            double along = 0;
            for (int i = 0; i < LEANINGS; i++) along += slope[i] * ROW(double, 4, i)[j];
            doubt += along * slope[j];
        }
        int stands = left[n] * left[n] < limit * limit * (variance + doubt);
        weight[n] = stands ? variance + (by_bearing * by_distortion) * (by_bearing * by_distortion) : 0;
        standing += stands;
    }
    double share = (double)standing / most, counts = worth * (share > 1 ? share : 1) * number[16];
    for (Py_ssize_t n = 0; n < size; n++) weight[n] = weight[n] != 0 ? 1 / (counts * weight[n]) : 0;
    return done(&given);
}

KERNEL(possible) {
    TAKE("d1d1xxl1!");
    Py_ssize_t size = LENGTH(0, 0);
    if (!sized(&given, LENGTH(1, 0) == size && LENGTH(2, 0) == 1)) return NULL;
    const double *azimuth = ARRAY(0)->buf, *rate = ARRAY(1)->buf;
    int64_t found = 0;
    for (Py_ssize_t n = 0; n < size; n++) found += fabs(azimuth[n]) <= given.number[0] && fabs(rate[n]) <= given.number[1];
    *(int64_t *)ARRAY(2)->buf = found;
    return done(&given);
}

KERNEL(nearby) {
    TAKE("d2d1l1d2l1l2!l1!");
    Py_ssize_t size = LENGTH(0, 0), others = LENGTH(3, 0), paired = 0;
    if (!sized(&given, LENGTH(0, 1) == 2 && LENGTH(1, 0) == size && LENGTH(2, 0) == size && LENGTH(3, 1) == 2 && LENGTH(4, 0) == others &&
                           LENGTH(5, 0) == 2 && LENGTH(5, 1) >= size * others && LENGTH(6, 0) == 1))
        return NULL;
    const double *reach = ARRAY(1)->buf;
    const int64_t *radars = ARRAY(2)->buf, *of = ARRAY(4)->buf;
    int64_t *mine = ROW(int64_t, 5, 0), *its = ROW(int64_t, 5, 1);
    for (Py_ssize_t n = 0; n < size; n++) {
        const double *point = ROW(double, 0, n);
        double square = reach[n] * reach[n];
        for (Py_ssize_t m = 0; m < others; m++) {
            if (of[m] != radars[n]) continue;
            const double *older = ROW(double, 3, m);
            double dx = point[0] - older[0], dy = point[1] - older[1];
            if (!(dx * dx + dy * dy < square)) continue;
            mine[paired] = n;
            its[paired++] = m;
        }
    }
    *(int64_t *)ARRAY(6)->buf = paired;
    return done(&given);
}

/* What a motion leaves of a range rate, modulo the ambiguity interval where there is one. */
static inline double left_of(double rate, const double *slope, double interval, double speed, double yaw_rate) {
    double left = rate - (speed * slope[0] + yaw_rate * slope[1]);
    return interval > 0 ? left - interval * rint(left / interval) : left;
}

KERNEL(common_motion) {
    TAKE("d1d1d1B1l1d2d2xxd1!");
    Py_ssize_t size = LENGTH(0, 0), scans = LENGTH(4, 0), pairs = LENGTH(6, 1), kept = 0;
    const double *cos = ARRAY(0)->buf, *sin = ARRAY(1)->buf, *all = ARRAY(2)->buf, *first = ROW(double, 6, 0), *second = ROW(double, 6, 1);
    const uint8_t *near = ARRAY(3)->buf;
    const int64_t *sizes = ARRAY(4)->buf;
    int fits = LENGTH(1, 0) == size && LENGTH(2, 0) == size && LENGTH(3, 0) == size && sizes_fit(&given, 4, scans, size) && LENGTH(5, 0) == scans && LENGTH(5, 1) == SCAN_VALUES &&
               LENGTH(6, 0) == 2 && LENGTH(7, 0) == 7;
    for (Py_ssize_t g = 0; fits && g < pairs; g++) fits = first[g] >= 0 && first[g] < 1 && second[g] >= 0 && second[g] < 1;
    if (!sized(&given, fits)) return NULL;
    double apart = given.number[0], tolerance = given.number[1], *out = ARRAY(7)->buf, *slope = malloc((4 * size + 1) * sizeof *slope);
    if (slope == NULL) {
        drop(&given);
        return PyErr_NoMemory();
    }
    double *interval = slope + 2 * size, *rate = slope + 3 * size;
    for (Py_ssize_t s = 0, n = 0; s < scans; s++) {
        const double *scan = ROW(double, 5, s);
        for (Py_ssize_t end = n + sizes[s]; n < end; n++) {
            if (!near[n]) continue;
            slope[2 * kept] = -cos[n];
            slope[2 * kept + 1] = scan[SENSOR_Y] * cos[n] - scan[SENSOR_X] * sin[n];
            interval[kept] = scan[AMBIGUITY];
            rate[kept++] = all[n];
        }
    }
    int64_t most = -1;
    double speed = 0, yaw_rate = 0;
    for (Py_ssize_t g = 0; kept && g < pairs; g++) {
        int64_t one = (int64_t)(first[g] * (double)kept), other = (int64_t)(second[g] * (double)kept);
        const double *ab = slope + 2 * one, *cd = slope + 2 * other, p = rate[one], q = rate[other];
        double determinant = ab[0] * cd[1] - ab[1] * cd[0];
        if (!(fabs(determinant) > apart)) continue;
        double guess = (p * cd[1] - ab[1] * q) / determinant, turn = (ab[0] * q - p * cd[0]) / determinant;
        int64_t explained = 0;
        for (Py_ssize_t n = 0; n < kept; n++) explained += fabs(left_of(rate[n], slope + 2 * n, interval[n], guess, turn)) < tolerance;
        if (explained > most) {
            most = explained;
            speed = guess;
            yaw_rate = turn;
        }
    }
    memset(out, 0, 7 * sizeof *out);
    out[2] = most >= 0;
    out[3] = (double)kept;
    double xx = 0, xy = 0, yy = 0, xr = 0, yr = 0;
    for (Py_ssize_t n = 0; most >= 0 && n < kept; n++) {
        double x = slope[2 * n], y = slope[2 * n + 1], left = left_of(rate[n], slope + 2 * n, interval[n], speed, yaw_rate);
        if (!(fabs(left) < tolerance)) continue;
        xx += x * x;
        xy += x * y;
        yy += y * y;
        xr += x * left;
        yr += y * left;
    }
    if (most >= 0) {
        out[0] = speed + (xr * yy - xy * yr) / (xx * yy - xy * xy);
        out[1] = yaw_rate + (xx * yr - xr * xy) / (xx * yy - xy * xy);
    }
    for (Py_ssize_t n = 0, m = 0; most >= 0 && n < size; n++) {
        if (!near[n]) continue;
        int is_explained = fabs(left_of(rate[m], slope + 2 * m, interval[m], out[0], out[1])) < tolerance;
        m++;
        if (!is_explained) continue;
        out[4]++;
        out[5] += cos[n];
        out[6] += sin[n];
    }
    free(slope);
    return done(&given);
}
