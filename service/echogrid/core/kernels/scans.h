/* One radar's frames put together: as `assemble` in reference.py. */
enum { OPEN, OPENED_NS, HAS_HEADER, NUMBER, HEADER_NS, EXPECTED, HAS_END, FRAMES, HAS_LAST, LAST, HAS_AGE, COUNT, STATES };
enum { REPEATED, WRONG_CYCLE, INCOMPLETE, BAD, BAD_CRC, COUNTERS };
enum { HEADER, DETECTIONS, END, AGE };
enum { ENDS_WITH_MESSAGE, NEEDS_HEADER, ALWAYS, MASK, TIMEOUT_NS, PER_FRAME, RULES };
#define ROW_BYTES 64

typedef struct {
    const int64_t *rule;
    int64_t *state, *slots, *numbers, *counters;
    uint8_t *rows; /* of detections; behind them header, end and age */
    Py_ssize_t most;
} Radar;

/* A signal's integer, as in `signals`. */
static int64_t integer_at(const uint8_t *payload, int64_t length, const int64_t *place) {
    uint64_t word = 0, sign = place[4] ? (uint64_t)1 << (place[3] - 1) : 0;
    for (int64_t k = 0; 8 * k < place[2] + place[3]; k++) {
        int64_t at = place[0] + k * place[1];
        uint64_t byte = at >= 0 && at < length ? payload[at] : 0;
        word |= 8 * k >= place[2] ? byte << (8 * k - place[2]) : byte >> (place[2] - 8 * k);
    }
    word &= place[3] < 64 ? ((uint64_t)1 << place[3]) - 1 : ~(uint64_t)0;
    return (int64_t)((word ^ sign) - sign);
}

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
    int64_t expected = rule[ALWAYS] < 0 ? state[EXPECTED] : rule[ALWAYS];
    return expected < 0 || state[FRAMES] >= expected;
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

KERNEL(assemble) {
    TAKE("l1l1B1B1l1B1l2l2l3l2!l2!l2!B3!l2!l1!");
    const int64_t *received = given.array[0].buf, *roles = given.array[1].buf, *begins = given.array[4].buf;
    const uint8_t *wrong = given.array[2].buf, *sizes = given.array[3].buf, *data = given.array[5].buf;
    Py_ssize_t frames = LENGTH(0, 0), radars = LENGTH(7, 0), most = LENGTH(10, 1), fields = LENGTH(8, 1), known = LENGTH(6, 0);
    int64_t *event = given.array[14].buf;
    int fits = LENGTH(6, 1) == 5 && LENGTH(7, 1) == RULES && LENGTH(8, 0) == radars && fields >= 3 && LENGTH(8, 2) == 5 && LENGTH(9, 0) == radars &&
               LENGTH(9, 1) == STATES && LENGTH(10, 0) == radars && LENGTH(11, 0) == radars && LENGTH(11, 1) == most && LENGTH(12, 0) == radars &&
               LENGTH(12, 1) == most + 3 && LENGTH(12, 2) == ROW_BYTES && LENGTH(13, 0) == radars && LENGTH(13, 1) == COUNTERS &&
               LENGTH(14, 0) == 2 && ARRAY(12)->strides[1] == ROW_BYTES && event[0] >= 0;
    for (int n = 1; n < 5; n++) fits &= LENGTH(n, 0) == frames;
    if (!sized(&given, fits)) return NULL;
    for (Py_ssize_t r = 0; fits && r < known; r++) {
        const int64_t *role = ROW(int64_t, 6, r);
        fits = role[0] < radars && role[2] >= 0 && role[2] <= ROW_BYTES;
    }
    for (Py_ssize_t n = event[0]; fits && n < frames; n++) fits = roles[n] < known && begins[n] >= 0 && begins[n] + sizes[n] <= LENGTH(5, 0);
    if (!sized(&given, fits)) return NULL;
    event[1] = -1;
    Py_ssize_t n = event[0];
    for (; n < frames && event[1] < 0; n++) {
        if (roles[n] < 0) continue;
        const int64_t *role = ROW(int64_t, 6, roles[n]), *field;
        int64_t r = role[0], kind = role[1], length = role[2], slot = role[3], last = role[4], number = -1;
        if (r < 0) continue;
        Radar radar = {ROW(int64_t, 7, r), ROW(int64_t, 9, r), ROW(int64_t, 10, r), ROW(int64_t, 11, r), ROW(int64_t, 13, r),
                       (uint8_t *)given.array[12].buf + r * ARRAY(12)->strides[0], most};
        const uint8_t *payload = data + begins[n];
        if (sizes[n] < length || wrong[n]) {
            radar.counters[BAD]++;
            radar.counters[BAD_CRC] += sizes[n] >= length;
            continue;
        }
        if (kind == AGE) {
            radar.state[HAS_AGE] = 1;
            memcpy(radar.rows + (most + 2) * ROW_BYTES, payload, length);
            continue;
        }
        int has_number = ROW3(int64_t, 8, r, 0)[3] > 0, numbered = has_number && ROW3(int64_t, 8, r, 1)[3] > 0;
        int64_t away = received[n] - radar.state[OPENED_NS];
        if (radar.state[OPEN] && (away > radar.rule[TIMEOUT_NS] || -away > radar.rule[TIMEOUT_NS])) give_up(&radar); /* a clock may be set back */
        if (kind == HEADER) {
            if (has_number) number = integer_at(payload, length, ROW3(int64_t, 8, r, 0));
            if (!take_header(&radar, received[n], has_number, number)) continue;
            int64_t count = 0, each = radar.rule[PER_FRAME];
            for (Py_ssize_t f = 3; f < fields; f++)
                if ((field = ROW3(int64_t, 8, r, f))[3] > 0) count += integer_at(payload, length, field);
            int counted = fields > 3 && ROW3(int64_t, 8, r, 3)[3] > 0;
            radar.state[COUNT] = counted ? count : -1;
            radar.state[EXPECTED] = !counted ? -1 : count > 0 ? (count + each - 1) / each : 0;
            memcpy(radar.rows + most * ROW_BYTES, payload, length);
        } else if (kind == DETECTIONS) {
            if ((field = ROW3(int64_t, 8, r, 1))[3] > 0) number = integer_at(payload, length, field);
            if ((field = ROW3(int64_t, 8, r, 2))[3] > 0) slot = integer_at(payload, length, field);
            if (!take_detections(&radar, received[n], slot, numbered, number, payload, length)) continue;
        }
        if (radar.rule[ENDS_WITH_MESSAGE]) {
            if (!last) continue;
            if (radar.state[OPEN]) {
                radar.state[HAS_END] = 1;
                memcpy(radar.rows + (most + 1) * ROW_BYTES, payload, length);
            }
        } else if (!(radar.state[OPEN] && is_whole(&radar)))
            continue;
        if (close_cycle(&radar, has_number, numbered)) event[1] = r;
    }
    event[0] = n;
    return done(&given);
}
