/* A patch around the car, and what was measured, into the tiles under them: as the functions of the same names in tiles.py. */
/* Where a row of map cells lies in the patch with its border of one zero cell: the cell to the lower left, -1 outside, and how far on from
 * its centre. */
WIDE static void place_row(const float *dx, Py_ssize_t width, float dy, float c, float s, float shift, int32_t cells, int32_t *flat, float *fu,
                           float *fv) {
    float limit = (float)(cells + 1), sine = s * dy, cosine = c * dy;
    for (Py_ssize_t j = 0; j < width; j++) {
        float u = c * dx[j] + sine + shift, v = cosine - s * dx[j] + shift;
        int32_t column = (int32_t)u, row = (int32_t)v;
        int inside = (u >= 0) & (v >= 0) & (u < limit) & (v < limit);
        flat[j] = inside ? row * (cells + 2) + column : -1;
        fu[j] = u - (float)column;
        fv[j] = v - (float)row;
    }
}

/* From where until before where a row lies inside, which is in one stretch: from cell to cell both places rise, or fall, all the way. */
static void inside_of(const int32_t *flat, int64_t width, int64_t *begin, int64_t *end) {
    for (*begin = 0; *begin < width && flat[*begin] < 0;) ++*begin;
    for (*end = width; *end > *begin && flat[*end - 1] < 0;) --*end;
}

/* A rectangle of map cells around the car, and how the patch lies on it. */
typedef struct {
    int64_t row, column, height, width; /* of the map */
    double cell, x, y;
    float c, s, shift;
} Lies;

#define LIES "xxxxxxxxxx"

static Lies lies_of(const double *number) {
    return (Lies){(int64_t)number[0], (int64_t)number[1], (int64_t)number[2], (int64_t)number[3], number[4], number[5], number[6], (float)number[7], (float)number[8], (float)number[9]};
}

/* Cells from the car to the centre of a map cell. */
static inline float from_car(int64_t n, double cell, double at) { return (float)(((0.5 + (double)n) * cell - at) / cell); }

KERNEL(bilinear) {
    TAKE("f3" LIES "f3!");
    const Lies lies = lies_of(given.number);
    Py_ssize_t planes = LENGTH(0, 0), cells = LENGTH(0, 1), width = lies.width, height = lies.height, across = cells + 2;
    if (!sized(&given, LENGTH(0, 2) == cells && LENGTH(1, 0) == planes && LENGTH(1, 1) == height && LENGTH(1, 2) == width)) return NULL;
    float *padded = calloc(planes * across * across, sizeof *padded), *dx = malloc(4 * width * sizeof *dx + 1), *fu = dx + width, *fv = fu + width;
    int32_t *flat = (int32_t *)(fv + width);
    if (padded == NULL || dx == NULL) {
        free(padded);
        free(dx);
        drop(&given);
        return PyErr_NoMemory();
    }
    Py_BEGIN_ALLOW_THREADS;
    for (Py_ssize_t p = 0; p < planes; p++)
        for (Py_ssize_t i = 0; i < cells; i++)
            memcpy(padded + (p * across + i + 1) * across + 1, ROW3(float, 0, p, i), cells * sizeof *padded);
    for (Py_ssize_t j = 0; j < width; j++) dx[j] = from_car(lies.column + j, lies.cell, lies.x);
    for (Py_ssize_t i = 0; i < height; i++) {
        place_row(dx, width, from_car(lies.row + i, lies.cell, lies.y), lies.c, lies.s, lies.shift, (int32_t)cells, flat, fu, fv);
        for (Py_ssize_t p = 0; p < planes; p++) {
            const float *plane = padded + p * across * across;
            float *out = ROW3(float, 1, p, i);
            for (Py_ssize_t j = 0; j < width; j++) {
                out[j] = 0;
                if (flat[j] < 0) continue;
                const float *lower = plane + flat[j], *upper = lower + across;
                float below = lower[0] * (1 - fu[j]) + lower[1] * fu[j], above = upper[0] * (1 - fu[j]) + upper[1] * fu[j];
                out[j] = below * (1 - fv[j]) + above * fv[j];
            }
        }
    }
    Py_END_ALLOW_THREADS;
    free(padded);
    free(dx);
    return done(&given);
}

KERNEL(add_clamped) {
    TAKE("f2xxf2!");
    Py_ssize_t height = LENGTH(0, 0), width = LENGTH(0, 1);
    if (!sized(&given, LENGTH(1, 0) == height && LENGTH(1, 1) == width)) return NULL;
    float clamp = (float)given.number[0], least = (float)given.number[1];
    for (Py_ssize_t i = 0; i < height; i++) {
        const float *added = ROW(float, 0, i);
        float *layer = ROW(float, 1, i);
        for (Py_ssize_t j = 0; j < width; j++) {
            float total = layer[j] + added[j];
            total = total < -clamp ? -clamp : total;
            total = total > clamp ? clamp : total;
            layer[j] = added[j] != 0 && total == 0 ? least : total;
        }
    }
    return done(&given);
}

/* Part of a tile under a rectangle: its first row and column in the tile, and in the map. */
typedef struct {
    int64_t row, column, height, width, map_row, map_column;
} Piece;

static void overlap(int64_t tile, int64_t first, int64_t length, int64_t *within, int64_t *count, int64_t *of_map) {
    int64_t begin = tile * SIDE, end = begin + SIDE;
    *of_map = begin > first ? begin : first;
    *within = *of_map - begin;
    *count = (end < first + length ? end : first + length) - *of_map;
}

/* Of the tile with a key, its row and column of tiles. */
static Piece piece_of(const int64_t *key, const Lies *lies) {
    Piece piece;
    overlap(key[0], lies->row, lies->height, &piece.row, &piece.height, &piece.map_row);
    overlap(key[1], lies->column, lies->width, &piece.column, &piece.width, &piece.map_column);
    return piece;
}

/* Whether a list has as many whole tiles, of at least so many layers where it is of layers. */
static int tiles_fit(const List *list, Py_ssize_t count, Py_ssize_t layers) {
    int fits = list->count == count;
    for (Py_ssize_t t = 0; fits && t < count; t++) {
        const Py_buffer *tile = &list->array[t];
        const Py_ssize_t *shape = tile->shape + (layers > 0), *strides = tile->strides + (layers > 0);
        fits = shape[0] == SIDE && shape[1] == SIDE && strides[0] == SIDE * tile->itemsize && (!layers || tile->shape[0] >= layers);
    }
    return fits;
}

#define TILE(type, n, t) ((type *)given.list[n].array[t].buf)
#define LAYER(n, t, layer) ((float *)((char *)given.list[n].array[t].buf + (layer) * given.list[n].array[t].strides[0]))

/* The bits of the patch cells whose centres are nearest; none outside. */
WIDE static void note_row(const int32_t *padded, int32_t across, const int32_t *flat, const float *fu, const float *fv, int64_t width, uint32_t now,
                          uint16_t *radars, uint32_t *seen) {
    int32_t bits[SIDE];
    for (int64_t j = 0; j < width; j++) {
        int32_t at = flat[j] + (fu[j] >= 0.5f) + (fv[j] >= 0.5f ? across : 0);
        bits[j] = flat[j] < 0 ? 0 : at;
    }
    for (int64_t j = 0; j < width; j++) bits[j] = padded[bits[j]];
    for (int64_t j = 0; j < width; j++) radars[j] |= (uint16_t)bits[j];
    for (int64_t j = 0; j < width; j++) seen[j] = bits[j] ? now : seen[j];
}

KERNEL(note_views) {
    TAKE("H2" LIES "xl2*H2!*I2!");
    Py_ssize_t cells = LENGTH(0, 0), tiles = LENGTH(1, 0), across = cells + 2;
    if (!sized(&given, LENGTH(0, 1) == cells && LENGTH(1, 1) == 2 && tiles_fit(&given.list[0], tiles, 0) && tiles_fit(&given.list[1], tiles, 0)))
        return NULL;
    const Lies lies = lies_of(given.number);
    float dx[SIDE], fu[SIDE], fv[SIDE];
    uint32_t now = (uint32_t)given.number[10];
    int32_t flat[SIDE];
    int32_t *padded = calloc(across * across, sizeof *padded);
    if (padded == NULL) {
        drop(&given);
        return PyErr_NoMemory();
    }
    Py_BEGIN_ALLOW_THREADS;
    for (Py_ssize_t i = 0; i < cells; i++)
        for (Py_ssize_t j = 0; j < cells; j++) padded[(i + 1) * across + j + 1] = ROW(uint16_t, 0, i)[j];
    for (Py_ssize_t t = 0; t < tiles; t++) {
        const Piece piece = piece_of(ROW(int64_t, 1, t), &lies);
        for (int64_t j = 0; j < piece.width; j++) dx[j] = from_car(piece.map_column + j, lies.cell, lies.x);
        for (int64_t i = 0; i < piece.height; i++) {
            int64_t first = (piece.row + i) * SIDE + piece.column;
            uint16_t *radars = TILE(uint16_t, 0, t) + first;
            uint32_t *seen = TILE(uint32_t, 1, t) + first;
            place_row(dx, piece.width, from_car(piece.map_row + i, lies.cell, lies.y), lies.c, lies.s, lies.shift, (int32_t)cells, flat, fu, fv);
            note_row(padded, (int32_t)across, flat, fu, fv, piece.width, now, radars, seen);
        }
    }
    Py_END_ALLOW_THREADS;
    free(padded);
    return done(&given);
}

/* A weighted log-odds and its weight, side by side, of a row of a patch. */
WIDE static void weigh_row(const float *log_odds, const float *weight, Py_ssize_t width, float share, float *restrict pairs) {
    for (Py_ssize_t j = 0; j < width; j++) {
        pairs[2 * j] = log_odds[j] * weight[j] * share;
        pairs[2 * j + 1] = weight[j] * share;
    }
}

/* Adds to a row of sums and weights the patch cells' by their four neighbours, and shrinks both where the weight exceeds `most`. A cell's
 * pair is fetched at once with its right neighbour's. */
WIDE static void add_row(const float *padded, Py_ssize_t across, const int32_t *flat, const float *fu, const float *fv, int64_t width, float most,
                         float *restrict total, float *restrict weight) {
    float lower[4 * SIDE], upper[4 * SIDE];
    for (int64_t j = 0; j < width; j++) {
        memcpy(lower + 4 * j, padded + 2 * flat[j], 16);
        memcpy(upper + 4 * j, padded + 2 * (flat[j] + across), 16);
    }
    for (int64_t j = 0; j < width; j++) {
        const float *one = lower + 4 * j, *other = upper + 4 * j;
        float right = fu[j], left = 1 - right, above = fv[j], below = 1 - above;
        float more = (one[0] * left + one[2] * right) * below + (other[0] * left + other[2] * right) * above;
        float heavier = (one[1] * left + one[3] * right) * below + (other[1] * left + other[3] * right) * above;
        float w = weight[j] + heavier, sum = total[j] + more;
        float kept = most / (w > 1 ? w : 1);
        kept = kept < 1 ? kept : 1;
        total[j] = sum * kept;
        weight[j] = w * kept;
    }
}

/* What `add_row` does where nothing is added: next to always nothing. */
WIDE static void shrink_row(int64_t width, float most, float *restrict total, float *restrict weight) {
    int over = 0;
    for (int64_t j = 0; j < width; j++) over |= weight[j] > most;
    for (int64_t j = 0; over && j < width; j++) {
        float kept = most / (weight[j] > 1 ? weight[j] : 1);
        kept = kept < 1 ? kept : 1;
        total[j] *= kept;
        weight[j] *= kept;
    }
}

KERNEL(add_looks) {
    TAKE("f3x" LIES "xl2*f3!");
    Py_ssize_t cells = LENGTH(0, 1), tiles = LENGTH(1, 0), across = cells + 2;
    if (!sized(&given, LENGTH(0, 0) == 2 && LENGTH(0, 2) == cells && LENGTH(1, 1) == 2 && tiles_fit(&given.list[0], tiles, 2))) return NULL;
    const Lies lies = lies_of(given.number + 1);
    float share = (float)given.number[0], most = (float)given.number[11], dx[SIDE], fu[SIDE], fv[SIDE];
    int32_t flat[SIDE];
    float *padded = calloc(across * across, 2 * sizeof *padded);
    if (padded == NULL) {
        drop(&given);
        return PyErr_NoMemory();
    }
    Py_BEGIN_ALLOW_THREADS;
    for (Py_ssize_t i = 0; i < cells; i++) weigh_row(ROW3(float, 0, 0, i), ROW3(float, 0, 1, i), cells, share, padded + 2 * ((i + 1) * across + 1));
    for (Py_ssize_t t = 0; t < tiles; t++) {
        const Piece piece = piece_of(ROW(int64_t, 1, t), &lies);
        for (int64_t j = 0; j < piece.width; j++) dx[j] = from_car(piece.map_column + j, lies.cell, lies.x);
        for (int64_t i = 0; i < piece.height; i++) {
            int64_t first = (piece.row + i) * SIDE + piece.column, begin, end;
            float *total = LAYER(0, t, 0) + first, *weight = LAYER(0, t, 1) + first;
            place_row(dx, piece.width, from_car(piece.map_row + i, lies.cell, lies.y), lies.c, lies.s, lies.shift, (int32_t)cells, flat, fu, fv);
            inside_of(flat, piece.width, &begin, &end);
            shrink_row(begin, most, total, weight);
            add_row(padded, across, flat + begin, fu + begin, fv + begin, end - begin, most, total + begin, weight + begin);
            shrink_row(piece.width - end, most, total + end, weight + end);
        }
    }
    Py_END_ALLOW_THREADS;
    free(padded);
    return done(&given);
}

KERNEL(add_measured) {
    TAKE("l1i1f1f1f1B1B1H1xxx*f3!*H2!*I2!");
    Py_ssize_t tiles = LENGTH(0, 0) - 1, size = LENGTH(1, 0);
    const int64_t *begins = ARRAY(0)->buf;
    const int32_t *cells = ARRAY(1)->buf;
    int fits = tiles >= 0 && tiles_fit(&given.list[0], tiles, 5) && tiles_fit(&given.list[1], tiles, 0) && tiles_fit(&given.list[2], tiles, 0);
    for (int n = 2; n < 8; n++) fits &= LENGTH(n, 0) == size;
    for (Py_ssize_t t = 0; fits && t < tiles; t++) fits = begins[t] >= 0 && begins[t] <= begins[t + 1] && begins[t + 1] <= size;
    for (Py_ssize_t n = 0; fits && n < size; n++) fits = cells[n] >= 0 && cells[n] < SIDE * SIDE;
    if (!sized(&given, fits)) return NULL;
    const float *hits = ARRAY(2)->buf, *near = ARRAY(3)->buf, *passes = ARRAY(4)->buf;
    const uint8_t *arrived = ARRAY(5)->buf, *left = ARRAY(6)->buf;
    const uint16_t *who = ARRAY(7)->buf;
    float gone = (float)given.number[1], most = (float)given.number[2];
    uint32_t now = (uint32_t)given.number[0];
    for (Py_ssize_t t = 0; t < tiles; t++) {
        float *hit = LAYER(0, t, 2), *beside = LAYER(0, t, 3), *passed = LAYER(0, t, 4);
        uint16_t *radars = TILE(uint16_t, 1, t);
        uint32_t *seen = TILE(uint32_t, 2, t);
        for (int64_t n = begins[t]; n < begins[t + 1]; n++) {
            int32_t at = cells[n];
            if (n + AHEAD < begins[t + 1]) {
                int32_t next = cells[n + AHEAD];
                __builtin_prefetch(&hit[next], 1);
                __builtin_prefetch(&beside[next], 1);
                __builtin_prefetch(&passed[next], 1);
                __builtin_prefetch(&radars[next], 1);
                __builtin_prefetch(&seen[next], 1);
            }
            if (who[n]) {
                radars[at] |= who[n];
                seen[at] = now;
            }
            float hit_here = hit[at], near_here = beside[at], passed_here = arrived[n] ? 0 : passed[at];
            if (left[n]) {
                hit_here = near_here = 0;
                passed_here = passed_here > gone ? passed_here : gone;
            }
            hit_here += hits[n];
            near_here += near[n];
            passed_here += passes[n];
            float total = hit_here + passed_here, kept = total > most ? most / total : 1;
            hit[at] = hit_here * kept;
            beside[at] = near_here * kept;
            passed[at] = passed_here * kept;
        }
    }
    return done(&given);
}
