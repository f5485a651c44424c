/* One radar's frames put together: as `assemble` in reference.py. */
enum { OPEN, OPENED_NS, HAS_HEADER, NUMBER, HEADER_NS, EXPECTED, HAS_END, FRAMES, HAS_LAST, LAST, HAS_AGE, COUNT, STATES };
enum { REPEATED, WRONG_CYCLE, INCOMPLETE, BAD, BAD_CRC, COUNTERS };
enum { HEADER, DETECTIONS, END, AGE };
enum { ENDS_WITH_MESSAGE, NEEDS_HEADER, ALWAYS, MASK, TIMEOUT_NS, PER_FRAME, PLAN, HEADER_PLAN, AGE_PLAN, MOST_DETECTIONS, BYTES, HEADER_BYTES, SUMMED_IN, SUM_FROM, SUM_AFTER, RULES };
enum { CYCLE_FIELD, DETECTIONS_CYCLE, PAGE, SUM, FIRST_COUNT };
enum { AT, NEWEST, SPAN_FIRST, SPAN_END, UNTIL, STEP, WHY, TAKEN, NOT_KNOWN, NOT_DATA, SCANS, DETECTIONS_THERE, BYTES_THERE, LOST, EVENTS };
enum { ALL_TAKEN, IS_DUE, IS_STRAY, IS_FULL, IS_UNREAD };
enum { PLACE, WHOSE, SCAN_OPENED_NS, SCAN_HAS_HEADER, SCAN_HEADER_NS, SCAN_NUMBER, SCAN_BEGIN, SCAN_END, INVALID, TRUNCATED, SUM_BEGIN, SUM_END, SUM_SAID, SCAN_COLUMNS };
#define NEVER INT64_MIN

typedef struct {
    const int64_t *rule;
    int64_t *state, *slots, *numbers, *counters;
    uint8_t *rows; /* of detections; behind them header, end and age */
    Py_ssize_t most;
} Radar;

static void give_up(Radar *radar) {
    radar->state[OPEN] = 0;
    radar->counters[INCOMPLETE]++;
}

static void open_cycle(Radar *radar, int64_t received_ns) {
    radar->state[OPEN] = 1;
    radar->state[OPENED_NS] = received_ns;
    radar->state[HAS_HEADER] = radar->state[HAS_END] = radar->state[FRAMES] = 0;
}

static int is_whole(const Radar *radar) {
    const int64_t *state = radar->state, *rule = radar->rule;
    if (!state[HAS_HEADER]) return !rule[NEEDS_HEADER] && state[FRAMES] == rule[ALWAYS];
    return state[FRAMES] >= (rule[ALWAYS] > state[EXPECTED] ? rule[ALWAYS] : state[EXPECTED]); /* a header may say more than there ever is */
}

/* Whether the cycle is whole: its frames then lie in the order of their slots, without those of other cycles. */
static int close_cycle(Radar *radar, int has_number, int numbered) {
    int64_t *state = radar->state, kept = 0;
    if (!state[OPEN]) return 0;
    state[OPEN] = 0;
    for (int64_t n = 0; n < state[FRAMES]; n++) {
        if (state[HAS_HEADER] && numbered && radar->numbers[n] != (state[NUMBER] & radar->rule[MASK])) {
            radar->counters[WRONG_CYCLE]++;
            continue;
        }
        int64_t at = kept++, slot = radar->slots[n], number = radar->numbers[n];
        uint8_t row[ROW_BYTES];
        memcpy(row, radar->rows + n * ROW_BYTES, ROW_BYTES);
        for (; at > 0 && radar->slots[at - 1] > slot; at--) {
            radar->slots[at] = radar->slots[at - 1];
            radar->numbers[at] = radar->numbers[at - 1];
            memcpy(radar->rows + at * ROW_BYTES, radar->rows + (at - 1) * ROW_BYTES, ROW_BYTES);
        }
        radar->slots[at] = slot;
        radar->numbers[at] = number;
        memcpy(radar->rows + at * ROW_BYTES, row, ROW_BYTES);
    }
    state[FRAMES] = kept;
    if (!is_whole(radar)) {
        radar->counters[INCOMPLETE]++;
        return 0;
    }
    if (state[HAS_HEADER]) {
        state[HAS_LAST] = has_number;
        state[LAST] = state[NUMBER];
    }
    return 1;
}

/* Whether a header is taken: it may be another cycle's, and is not if it comes twice. */
static int take_header(Radar *radar, int64_t received_ns, int has_number, int64_t number) {
    int64_t *state = radar->state;
    int inside = state[OPEN] && state[HAS_HEADER];
    if (has_number && ((inside && state[NUMBER] == number) || (!inside && state[HAS_LAST] && state[LAST] == number))) {
        radar->counters[REPEATED]++;
        return 0;
    }
    if (state[OPEN] && (state[HAS_HEADER] || !radar->rule[ENDS_WITH_MESSAGE])) give_up(radar);
    if (!state[OPEN]) open_cycle(radar, received_ns);
    state[HAS_HEADER] = 1;
    state[NUMBER] = number;
    state[HEADER_NS] = received_ns;
    return 1;
}

static int take_detections(Radar *radar, int64_t received_ns, int64_t slot, int numbered, int64_t number, const uint8_t *payload, int64_t length) {
    int64_t *state = radar->state;
    if (!state[OPEN]) {
        if (!radar->rule[ENDS_WITH_MESSAGE]) { /* the header comes first, and none came */
            radar->counters[WRONG_CYCLE]++;
            return 0;
        }
        open_cycle(radar, received_ns);
    }
    if (state[HAS_HEADER] && numbered && number != (state[NUMBER] & radar->rule[MASK])) {
        radar->counters[WRONG_CYCLE]++;
        return 0;
    }
    if (slot < 0) slot = state[FRAMES];
    for (int64_t n = 0; n < state[FRAMES]; n++)
        if (radar->slots[n] == slot) {
            radar->counters[REPEATED]++;
            return 0;
        }
    if (state[FRAMES] == radar->most) {
        give_up(radar);
        return 0;
    }
    radar->slots[state[FRAMES]] = slot;
    radar->numbers[state[FRAMES]] = number;
    memcpy(radar->rows + state[FRAMES]++ * ROW_BYTES, payload, length);
    return 1;
}

/* Where whole scans go. */
typedef struct {
    int64_t *rows;
    double *values; /* (S, 3): age, ambiguity, blockage */
    double *columns; /* range, azimuth, range rate and RCS, of so many each */
    uint8_t *summed;
    Py_ssize_t room, most, bytes; /* scans, detections, summed bytes */
    Py_ssize_t scans, used, summed_bytes;
} Scans;

typedef struct {
    double range;
    Py_ssize_t at;
} Distance;

static int by_distance(const void *one, const void *other) {
    const Distance *a = one, *b = other;
    return a->range != b->range ? (a->range > b->range) - (a->range < b->range) : (a->at > b->at) - (a->at < b->at);
}

/* Leaves the `most` nearest of detections, in their order; false where there is no memory. */
static int keep_nearest(Scans *scans, Py_ssize_t begin, Py_ssize_t count, Py_ssize_t most) {
    Distance *order = malloc(count * sizeof *order);
    uint8_t *kept = calloc(count, 1);
    int ok = order != NULL && kept != NULL;
    if (ok) {
        for (Py_ssize_t n = 0; n < count; n++) order[n] = (Distance){scans->columns[begin + n], n};
        qsort(order, count, sizeof *order, by_distance);
        for (Py_ssize_t n = 0; n < most; n++) kept[order[n].at] = 1;
        for (Py_ssize_t n = 0, to = 0; n < count; n++)
            if (kept[n]) {
                for (int c = 0; c < 4; c++) scans->columns[c * scans->most + begin + to] = scans->columns[c * scans->most + begin + n];
                to++;
            }
    }
    free(order);
    free(kept);
    return ok;
}

/* The detections of a whole cycle that say something, as in `_detections`; false where there is no memory. */
static int read_detections(const Radar *radar, const Plans *plans, Scans *scans, int64_t *row) {
    const int64_t *state = radar->state, *rule = radar->rule;
    int64_t each = plans->numbers[rule[PLAN] + PLAN_EACH], count = state[FRAMES] * each;
    Py_ssize_t begin = scans->used, kept = 0, most = scans->most;
    double *columns = scans->columns + begin;
    for (int c = 0; c < 4; c++) /* not every sensor says the RCS */
        for (Py_ssize_t n = 0; n < count; n++) columns[c * most + n] = NAN;
    evaluate(plans, rule[PLAN], radar->rows, state[FRAMES], columns, most);
    if (state[HAS_HEADER] && state[COUNT] >= 0 && state[COUNT] < count) count = state[COUNT];
    for (Py_ssize_t n = 0; n < count; n++) {
        double range = columns[n];
        if (!(isfinite(range + columns[most + n] + columns[2 * most + n]) && range > 0)) continue;
        for (int c = 0; c < 4; c++) columns[c * most + kept] = columns[c * most + n];
        kept++;
    }
    row[INVALID] = count - kept;
    row[TRUNCATED] = kept > rule[MOST_DETECTIONS] ? kept - rule[MOST_DETECTIONS] : 0;
    if (row[TRUNCATED] && !keep_nearest(scans, begin, kept, rule[MOST_DETECTIONS])) return 0;
    row[SCAN_BEGIN] = begin;
    row[SCAN_END] = scans->used = begin + kept - row[TRUNCATED];
    return 1;
}

/* What the cycle's checksum is over, and what it says. */
static void read_sum(const Radar *radar, const int64_t *place, Py_ssize_t most, Scans *scans, int64_t *row) {
    const int64_t *state = radar->state, *rule = radar->rule;
    row[SUM_BEGIN] = row[SUM_END] = -1;
    if (rule[SUMMED_IN] < 0 || !state[HAS_HEADER] || (rule[SUMMED_IN] == END && !state[HAS_END])) return;
    const uint8_t *header = radar->rows + most * ROW_BYTES, *end = header + ROW_BYTES;
    uint8_t *to = scans->summed + scans->summed_bytes;
    row[SUM_BEGIN] = scans->summed_bytes;
    if (rule[SUMMED_IN] == END) {
        memcpy(to, header, rule[HEADER_BYTES]);
        to += rule[HEADER_BYTES];
    } else {
        memcpy(to, header, rule[SUM_FROM]);
        memcpy(to + rule[SUM_FROM], header + rule[SUM_AFTER], rule[HEADER_BYTES] - rule[SUM_AFTER]);
        to += rule[HEADER_BYTES] - (rule[SUM_AFTER] - rule[SUM_FROM]);
    }
    for (Py_ssize_t n = 0; n < state[FRAMES]; n++, to += rule[BYTES]) memcpy(to, radar->rows + n * ROW_BYTES, rule[BYTES]);
    row[SUM_END] = scans->summed_bytes = to - scans->summed;
    row[SUM_SAID] = integer_at(rule[SUMMED_IN] == END ? end : header, ROW_BYTES, place);
}

/* A whole cycle as a scan; what its plan cannot say is left to the caller. */
static int read_cycle(Radar *radar, const Plans *plans, const int64_t *sum, Scans *scans, int64_t at, int64_t number) {
    int64_t *state = radar->state, *row = scans->rows + scans->scans * SCAN_COLUMNS;
    const int64_t *rule = radar->rule;
    const uint8_t *header = radar->rows + radar->most * ROW_BYTES;
    double *values = scans->values + 3 * scans->scans++;
    memset(row, 0, SCAN_COLUMNS * sizeof *row);
    row[PLACE] = at;
    row[WHOSE] = number;
    row[SCAN_OPENED_NS] = state[OPENED_NS];
    row[SCAN_HAS_HEADER] = state[HAS_HEADER];
    row[SCAN_HEADER_NS] = state[HEADER_NS];
    row[SCAN_NUMBER] = state[NUMBER];
    values[0] = values[1] = values[2] = NAN;
    read_sum(radar, sum, radar->most, scans, row);
    if (rule[PLAN] < 0) return 1;
    if (state[HAS_HEADER] && rule[HEADER_PLAN] >= 0) evaluate(plans, rule[HEADER_PLAN], header, 1, values, 1);
    if (state[HAS_AGE] && rule[AGE_PLAN] >= 0) evaluate(plans, rule[AGE_PLAN], header + 2 * ROW_BYTES, 1, values, 1);
    state[HAS_AGE] = 0;
    return read_detections(radar, plans, scans, row);
}

static int rule_fits(const Plans *plans, const int64_t *rule, Py_ssize_t most, Py_ssize_t detections, Py_ssize_t summed) {
    int fits = plan_fits(plans, rule[PLAN], 4) && plan_fits(plans, rule[HEADER_PLAN], 3) && plan_fits(plans, rule[AGE_PLAN], 3);
    for (int n = PLAN; fits && n <= AGE_PLAN; n++) {
        if (rule[n] < 0) continue;
        const int64_t *plan = plans->numbers + rule[n];
        fits = plan[PLAN_BYTES] <= ROW_BYTES && (n == PLAN ? (most + 1) * plan[PLAN_EACH] <= detections : plan[PLAN_EACH] == 1);
    }
    return fits && rule[BYTES] >= 0 && rule[BYTES] <= ROW_BYTES && rule[HEADER_BYTES] >= 0 && rule[HEADER_BYTES] <= ROW_BYTES && rule[SUM_FROM] >= 0 &&
           rule[SUM_FROM] <= rule[SUM_AFTER] && rule[SUM_AFTER] <= rule[HEADER_BYTES] && (most + 2) * ROW_BYTES <= summed && rule[MOST_DETECTIONS] >= 0;
}

/* Takes one radar's frame; whether it makes a cycle whole. */
static int take_frame(Radar *radar, const int64_t *fields, Py_ssize_t width, const int64_t *role, int64_t received_ns, int64_t size, int wrong,
                      const uint8_t *payload) {
    int64_t kind = role[1], length = role[2], slot = role[3], last = role[4], number = -1;
    Py_ssize_t most = radar->most;
    if (size < length || wrong) {
        radar->counters[BAD]++;
        radar->counters[BAD_CRC] += size >= length;
        return 0;
    }
    if (kind == AGE) {
        radar->state[HAS_AGE] = 1;
        memcpy(radar->rows + (most + 2) * ROW_BYTES, payload, length);
        return 0;
    }
    int has_number = fields[5 * CYCLE_FIELD + 3] > 0, numbered = has_number && fields[5 * DETECTIONS_CYCLE + 3] > 0;
    int64_t away = received_ns - radar->state[OPENED_NS];
    if (radar->state[OPEN] && (away > radar->rule[TIMEOUT_NS] || -away > radar->rule[TIMEOUT_NS])) give_up(radar); /* a clock may be set back */
    if (kind == HEADER) {
        if (has_number) number = integer_at(payload, length, fields + 5 * CYCLE_FIELD);
        if (!take_header(radar, received_ns, has_number, number)) return 0;
        int64_t count = 0, each = radar->rule[PER_FRAME];
        for (Py_ssize_t f = FIRST_COUNT; f < width; f++)
            if (fields[5 * f + 3] > 0) count += integer_at(payload, length, fields + 5 * f);
        int counted = width > FIRST_COUNT && fields[5 * FIRST_COUNT + 3] > 0;
        radar->state[COUNT] = counted ? count : -1;
        radar->state[EXPECTED] = !counted ? -1 : count > 0 ? (count + each - 1) / each : 0;
        memcpy(radar->rows + most * ROW_BYTES, payload, length);
    } else if (kind == DETECTIONS) {
        if (fields[5 * DETECTIONS_CYCLE + 3] > 0) number = integer_at(payload, length, fields + 5 * DETECTIONS_CYCLE);
        if (fields[5 * PAGE + 3] > 0) slot = integer_at(payload, length, fields + 5 * PAGE);
        if (!take_detections(radar, received_ns, slot, numbered, number, payload, length)) return 0;
    }
    if (radar->rule[ENDS_WITH_MESSAGE]) {
        if (!last) return 0;
        if (radar->state[OPEN]) {
            radar->state[HAS_END] = 1;
            memcpy(radar->rows + (most + 1) * ROW_BYTES, payload, length);
        }
    } else if (!(radar->state[OPEN] && is_whole(radar)))
        return 0;
    return close_cycle(radar, has_number, numbered);
}

KERNEL(assemble) {
    TAKE("l1l1B1B1B1l1B1l2l2l3l2!l2!l2!B3!l2!l1d1xl1!l2!d2!d2!B1!");
    const int64_t *received = ARRAY(0)->buf, *roles = ARRAY(1)->buf, *begins = ARRAY(5)->buf;
    const uint8_t *kinds = ARRAY(2)->buf, *wrong = ARRAY(3)->buf, *sizes = ARRAY(4)->buf, *data = ARRAY(6)->buf;
    Py_ssize_t frames = LENGTH(0, 0), radars = LENGTH(8, 0), most = LENGTH(11, 1), known = LENGTH(7, 0), width = LENGTH(9, 1);
    int64_t *event = ARRAY(17)->buf;
    Plans plans = {ARRAY(15)->buf, ARRAY(16)->buf, LENGTH(15, 0), LENGTH(16, 0), given.number[0]};
    Scans scans = {ARRAY(18)->buf, ARRAY(19)->buf, ARRAY(20)->buf, ARRAY(21)->buf, LENGTH(18, 0), LENGTH(20, 1), LENGTH(21, 0), 0, 0, 0};
    int fits = LENGTH(7, 1) == 5 && LENGTH(8, 1) == RULES && LENGTH(9, 0) == radars && width >= FIRST_COUNT && LENGTH(9, 2) == 5 &&
               LENGTH(10, 0) == radars && LENGTH(10, 1) == STATES && LENGTH(11, 0) == radars && LENGTH(12, 0) == radars && LENGTH(12, 1) == most &&
               LENGTH(13, 0) == radars && LENGTH(13, 1) == most + 3 && LENGTH(13, 2) == ROW_BYTES && ARRAY(13)->strides[1] == ROW_BYTES &&
               LENGTH(14, 0) == radars && LENGTH(14, 1) == COUNTERS && LENGTH(17, 0) == EVENTS && LENGTH(18, 1) == SCAN_COLUMNS && scans.room > 0 &&
               LENGTH(19, 0) == scans.room && LENGTH(19, 1) == 3 && LENGTH(20, 0) == 4 && event[AT] >= 0 && event[UNTIL] <= frames;
    for (int n = 1; n < 6; n++) fits &= LENGTH(n, 0) == frames;
    for (int n = 18; n < 21; n++) fits &= ARRAY(n)->strides[0] == LENGTH(n, 1) * 8;
    fits &= ARRAY(9)->strides[1] == 5 * 8;
    if (!sized(&given, fits)) return NULL;
    for (Py_ssize_t r = 0; fits && r < known; r++) {
        const int64_t *role = ROW(int64_t, 7, r);
        fits = role[0] < radars && role[2] >= 0 && role[2] <= ROW_BYTES;
    }
    for (Py_ssize_t r = 0; fits && r < radars; r++) {
        fits = rule_fits(&plans, ROW(int64_t, 8, r), most, scans.most, scans.bytes);
        for (Py_ssize_t f = 0; fits && f < width; f++) fits = place_fits(ROW3(int64_t, 9, r, f));
    }
    if (!sized(&given, fits)) return NULL;
    Py_ssize_t n = event[AT];
    int64_t newest = event[NEWEST];
    event[WHY] = ALL_TAKEN;
    event[TAKEN] = event[NOT_KNOWN] = event[NOT_DATA] = 0;
    while (n < event[UNTIL] && event[WHY] == ALL_TAKEN) {
        if (!sized(&given, roles[n] < known && begins[n] >= 0 && begins[n] + sizes[n] <= LENGTH(6, 0))) return NULL;
        const int64_t *role = roles[n] < 0 ? NULL : ROW(int64_t, 7, roles[n]);
        if (role != NULL && role[0] >= 0) {
            const int64_t *rule = ROW(int64_t, 8, role[0]), *state = ROW(int64_t, 10, role[0]);
            int64_t next = (state[OPEN] ? state[FRAMES] : 0) + 1, each = rule[PLAN] < 0 ? 0 : plans.numbers[rule[PLAN] + PLAN_EACH];
            if (scans.scans == scans.room || scans.used + next * each > scans.most || scans.summed_bytes + (next + 1) * ROW_BYTES > scans.bytes) {
                event[WHY] = IS_FULL;
                break;
            }
        }
        if (kinds[n] & COUNTS) {
            int64_t away = newest == NEVER ? 0 : received[n] - newest;
            if (away > event[STEP] || -away > event[STEP]) {
                event[WHY] = IS_STRAY;
                break;
            }
            if (received[n] > newest) newest = received[n];
            event[TAKEN]++;
            event[NOT_KNOWN] += (kinds[n] & UNKNOWN) != 0;
            event[NOT_DATA] += (kinds[n] & REMOTELY) != 0;
        }
        if (newest < event[SPAN_FIRST] || newest >= event[SPAN_END]) event[WHY] = IS_DUE;
        if (role != NULL && role[0] >= 0) {
            int64_t r = role[0];
            Radar radar = {ROW(int64_t, 8, r), ROW(int64_t, 10, r), ROW(int64_t, 11, r), ROW(int64_t, 12, r), ROW(int64_t, 14, r),
                           (uint8_t *)ARRAY(13)->buf + r * ARRAY(13)->strides[0], most};
            const int64_t *fields = ROW3(int64_t, 9, r, 0);
            if (take_frame(&radar, fields, width, role, received[n], sizes[n], wrong[n], data + begins[n])) {
                if (!read_cycle(&radar, &plans, fields + 5 * SUM, &scans, n, r)) {
                    drop(&given);
                    return PyErr_NoMemory();
                }
                if (radar.rule[PLAN] < 0 && event[WHY] == ALL_TAKEN) event[WHY] = IS_UNREAD;
            }
        }
        n++;
    }
    event[AT] = n;
    event[NEWEST] = newest;
    event[SCANS] = scans.scans;
    event[DETECTIONS_THERE] = scans.used;
    event[BYTES_THERE] = scans.summed_bytes;
    event[LOST] = 0;
    for (Py_ssize_t r = 0; r < radars; r++)
        for (int c = 0; c < COUNTERS; c++) event[LOST] += ROW(int64_t, 14, r)[c];
    return done(&given);
}
