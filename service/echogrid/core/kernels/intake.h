/* What frames are and say, each for itself: as in frames.py. */
enum { PLAN_BYTES, PLAN_EACH, PLAN_ALL, PLAN_SIGNALS, PLAN_QUANTITIES, PLAN_FLAGS, PLAN_NUMBERS, PLAN_SCALES, PLAN_HEAD };
enum { COUNTS = 1, UNKNOWN = 2, REMOTELY = 4, OTHER = 8 };
enum { EXTENDED_BIT = 1, REMOTE_BIT = 2, ERROR_BIT = 4 };
enum { CHECK_TABLE, CHECK_BYTES, CHECK_PLACE, CHECK_COLUMNS = CHECK_PLACE + 5 };
enum { SAYS_BYTES, SAYS_WHEELS, SAYS_YAW, SAYS_COUNTER, SAYS_DIRECTION = SAYS_COUNTER + 5, SAYS_COLUMNS = SAYS_DIRECTION + 5 };
#define ROW_BYTES 64
#define MOST_READY 128 /* signals of a plan */
#define LATEST 4.6e9 /* s since 1970: differences of two such times are whole numbers of ns yet */

typedef struct {
    const int64_t *numbers;
    const double *scales;
    Py_ssize_t ints, doubles;
    double greatest;
} Plans;

static int place_fits(const int64_t *place) {
    return place[0] >= -1024 && place[0] <= 1024 && (place[1] == 1 || place[1] == -1) && place[2] >= 0 && place[2] < 8 && place[3] >= 0 && place[3] <= 64;
}

static const int64_t *places_of(const int64_t *plan) { return plan + PLAN_HEAD; }
static const int64_t *quantities_of(const int64_t *plan) { return places_of(plan) + 5 * plan[PLAN_SIGNALS]; }
static const int64_t *flags_of(const int64_t *plan) { return quantities_of(plan) + 4 * plan[PLAN_QUANTITIES]; }

/* Whether the plan that begins at `at`, if any, lies within the arrays, reads within payloads and writes so many columns. */
static int plan_fits(const Plans *plans, int64_t at, int64_t columns) {
    if (at < 0) return 1;
    if (at + PLAN_HEAD > plans->ints) return 0;
    const int64_t *plan = plans->numbers + at;
    for (int n = 0; n < PLAN_HEAD; n++)
        if (n != PLAN_ALL && (plan[n] < 0 || plan[n] > (1 << 24))) return 0;
    int64_t signals = plan[PLAN_SIGNALS], kinds = plan[PLAN_QUANTITIES], flags = plan[PLAN_FLAGS], each = plan[PLAN_EACH];
    if (signals > MOST_READY || at + PLAN_HEAD + 5 * signals + 4 * kinds + 4 * flags + plan[PLAN_NUMBERS] > plans->ints || plan[PLAN_ALL] >= flags ||
        plan[PLAN_SCALES] + 2 * (signals + kinds) > plans->doubles)
        return 0;
    for (int64_t s = 0; s < signals; s++)
        if (!place_fits(places_of(plan) + 5 * s)) return 0;
    for (int64_t q = 0; q < kinds; q++) {
        const int64_t *one = quantities_of(plan) + 4 * q;
        if (one[0] < 0 || (one[0] + 1) * each > signals || one[1] >= flags || one[2] >= flags || one[3] < 0 || one[3] >= columns) return 0;
    }
    for (int64_t f = 0; f < flags; f++) {
        const int64_t *flag = flags_of(plan) + 4 * f;
        if (flag[0] < 0 || (flag[0] + 1) * each > signals || flag[2] < 0 || flag[3] > plan[PLAN_NUMBERS]) return 0;
    }
    return 1;
}

/* A signal of a plan, ready to be read from many payloads: a word's first byte, or -1 where it does not lie in the payload as a whole. */
typedef struct {
    int64_t first;
    uint64_t mask, sign;
    double scale, offset;
    const int64_t *place;
    int shift, upwards;
} Signal;

static void make_ready(const int64_t *plan, const double *linear, Signal *signals) {
    for (int64_t s = 0; s < plan[PLAN_SIGNALS]; s++) {
        const int64_t *place = places_of(plan) + 5 * s;
        int upwards = place[1] > 0;
        int64_t first = upwards ? place[0] : place[0] - 7;
        int whole = place[2] + place[3] <= 64 && first >= 0 && first + 8 <= plan[PLAN_BYTES];
        uint64_t mask = place[3] < 64 ? ((uint64_t)1 << place[3]) - 1 : ~(uint64_t)0, sign = place[4] ? (uint64_t)1 << (place[3] - 1) : 0;
        signals[s] = (Signal){whole ? first : -1, mask, sign, linear[2 * s], linear[2 * s + 1], place, (int)place[2], upwards};
    }
}

static inline int64_t signal_of(const Signal *signal, const uint8_t *payload, int64_t bytes) {
    uint64_t word;
    if (signal->first < 0) return integer_at(payload, bytes, signal->place);
    memcpy(&word, payload + signal->first, sizeof word);
    word = signal->upwards == LITTLE ? word : __builtin_bswap64(word);
    word = word >> signal->shift & signal->mask;
    return (int64_t)((word ^ signal->sign) - signal->sign);
}

static inline int flag_holds(const int64_t *plan, int64_t f, int64_t k, const Signal *signals, const uint8_t *payload) {
    const int64_t *flag = flags_of(plan) + 4 * f, *numbers = flags_of(plan) + 4 * plan[PLAN_FLAGS];
    int64_t value = signal_of(signals + flag[0] * plan[PLAN_EACH] + k, payload, plan[PLAN_BYTES]);
    int found = 0;
    for (int64_t i = flag[2]; i < flag[3]; i++) found |= value == numbers[i];
    return found == (int)flag[1];
}

/* Quantities of payloads, one every 64 bytes, `each` of each into its column, of which there is one every `stride`. As `evaluate`. */
static void evaluate(const Plans *plans, int64_t at, const uint8_t *payloads, Py_ssize_t size, double *out, Py_ssize_t stride) {
    const int64_t *plan = plans->numbers + at, *kinds = quantities_of(plan);
    const double *linear = plans->scales + plan[PLAN_SCALES], *units = linear + 2 * plan[PLAN_SIGNALS];
    int64_t each = plan[PLAN_EACH];
    Signal signals[MOST_READY];
    make_ready(plan, linear, signals);
    for (Py_ssize_t n = 0; n < size; n++)
        for (int64_t k = 0; k < each; k++) {
            const uint8_t *payload = payloads + n * ROW_BYTES;
            int sound = plan[PLAN_ALL] < 0 || flag_holds(plan, plan[PLAN_ALL], k, signals, payload);
            for (int64_t q = 0; q < plan[PLAN_QUANTITIES]; q++) {
                const int64_t *kind = kinds + 4 * q; /* row of its signal, flag of its validity, flag of its sign, column; -1: no flag */
                const Signal *signal = signals + kind[0] * each + k;
                double value = (double)signal_of(signal, payload, plan[PLAN_BYTES]) * signal->scale + signal->offset;
                value = value * units[2 * q] + units[2 * q + 1];
                if (kind[2] >= 0 && flag_holds(plan, kind[2], k, signals, payload)) value = -value;
                if (!sound || (kind[1] >= 0 && !flag_holds(plan, kind[1], k, signals, payload))) value = NAN;
                out[kind[3] * stride + n * each + k] = fabs(value) < plans->greatest ? value : NAN;
            }
        }
}

/* Row of the key's reader; -1 for nobody's. */
static int64_t row_of(int64_t key, const int64_t *keys, const int64_t *rows, Py_ssize_t size) {
    Py_ssize_t low = 0, high = size;
    while (low < high) {
        Py_ssize_t middle = (low + high) / 2;
        if (keys[middle] < key) low = middle + 1;
        else high = middle;
    }
    return low < size && keys[low] == key ? rows[low] : -1;
}

KERNEL(identify) {
    TAKE("d1I1B1B1l1B1l1l1l1l2l2Q2l2l1d1xl1!l1!B1!B1!d2!l2!");
    const double *stamps = ARRAY(0)->buf;
    const uint32_t *ids = ARRAY(1)->buf;
    const uint8_t *flags = ARRAY(2)->buf, *sizes = ARRAY(3)->buf, *data = ARRAY(5)->buf;
    const int64_t *begins = ARRAY(4)->buf, *buses = ARRAY(6)->buf, *keys = ARRAY(7)->buf, *rows = ARRAY(8)->buf;
    int64_t *received = ARRAY(15)->buf, *roles = ARRAY(16)->buf;
    uint8_t *kinds = ARRAY(17)->buf, *wrong = ARRAY(18)->buf;
    Py_ssize_t frames = LENGTH(0, 0), readers = LENGTH(7, 0), known = LENGTH(9, 0);
    Plans plans = {ARRAY(13)->buf, ARRAY(14)->buf, LENGTH(13, 0), LENGTH(14, 0), given.number[0]};
    int fits = LENGTH(8, 0) == readers && LENGTH(9, 1) == 5 && LENGTH(10, 0) == known && LENGTH(10, 1) == CHECK_COLUMNS && LENGTH(11, 1) == 256 &&
               LENGTH(12, 0) == known && LENGTH(12, 1) == SAYS_COLUMNS && LENGTH(19, 1) == 3 && LENGTH(20, 1) == 2;
    for (int n = 1; n < 5; n++) fits &= LENGTH(n, 0) == frames;
    fits &= LENGTH(6, 0) == frames;
    for (int n = 15; n < 21; n++) fits &= LENGTH(n, 0) == frames;
    if (!sized(&given, fits)) return NULL;
    for (Py_ssize_t r = 0; fits && r < readers; r++) fits = rows[r] >= 0 && rows[r] < known;
    for (Py_ssize_t r = 0; fits && r < known; r++) {
        const int64_t *check = ROW(int64_t, 10, r), *says = ROW(int64_t, 12, r);
        fits = (check[CHECK_TABLE] < 0 || (check[CHECK_BYTES] >= 0 && check[CHECK_TABLE] + check[CHECK_BYTES] <= LENGTH(11, 0))) &&
               place_fits(check + CHECK_PLACE) && place_fits(says + SAYS_COUNTER) && place_fits(says + SAYS_DIRECTION) &&
               plan_fits(&plans, says[SAYS_WHEELS], 2) && plan_fits(&plans, says[SAYS_YAW], 1);
        for (int n = SAYS_WHEELS; fits && n <= SAYS_YAW; n++) fits = says[n] < 0 || plans.numbers[says[n]] <= says[SAYS_BYTES];
        for (int n = SAYS_WHEELS; fits && n <= SAYS_YAW; n++) fits = says[n] < 0 || plans.numbers[says[n] + PLAN_EACH] == 1;
    }
    for (Py_ssize_t n = 0; fits && n < frames; n++) fits = begins[n] >= 0 && begins[n] + sizes[n] <= LENGTH(5, 0);
    if (!sized(&given, fits)) return NULL;
    for (Py_ssize_t n = 0; n < frames; n++) {
        double seconds, fraction = modf(fabs(stamps[n]) < LATEST ? stamps[n] : 0, &seconds);
        received[n] = ((int64_t)seconds * 1000000 + (int64_t)rint(fraction * 1e6)) * 1000;
        int counts = !(flags[n] & ERROR_BIT), remote = flags[n] & REMOTE_BIT;
        int64_t row = row_of(buses[n] * ((int64_t)1 << 33) | (int64_t)(flags[n] & EXTENDED_BIT) << 32 | ids[n], keys, rows, readers);
        int64_t role = roles[n] = counts && !remote ? row : -1;
        int other = role >= 0 && ROW(int64_t, 9, role)[0] < 0;
        kinds[n] = (uint8_t)(counts * (COUNTS | (row < 0) * UNKNOWN | (row >= 0 && remote) * REMOTELY) | other * OTHER);
        double *values = ROW(double, 19, n);
        int64_t *counted = ROW(int64_t, 20, n);
        wrong[n] = 0;
        values[0] = values[1] = values[2] = NAN;
        counted[0] = counted[1] = 0;
        if (role < 0) continue;
        const uint8_t *payload = data + begins[n];
        const int64_t *check = ROW(int64_t, 10, role), *says = ROW(int64_t, 12, role);
        if (check[CHECK_TABLE] >= 0 && sizes[n] >= check[CHECK_BYTES]) {
            uint64_t sum = 0;
            for (int64_t k = 0; k < check[CHECK_BYTES]; k++) sum ^= ROW(uint64_t, 11, check[CHECK_TABLE] + k)[payload[k]];
            wrong[n] = sum != (uint64_t)integer_at(payload, check[CHECK_BYTES], check + CHECK_PLACE);
        }
        if (says[SAYS_BYTES] < 0) continue;
        if (sizes[n] < says[SAYS_BYTES]) {
            wrong[n] = 1;
            continue;
        }
        if (says[SAYS_WHEELS] >= 0) evaluate(&plans, says[SAYS_WHEELS], payload, 1, values, 1);
        if (says[SAYS_YAW] >= 0) evaluate(&plans, says[SAYS_YAW], payload, 1, values + 2, 1);
        if (says[SAYS_COUNTER + 3] > 0) counted[0] = integer_at(payload, says[SAYS_BYTES], says + SAYS_COUNTER);
        if (says[SAYS_DIRECTION + 3] > 0) counted[1] = integer_at(payload, says[SAYS_BYTES], says + SAYS_DIRECTION);
    }
    return done(&given);
}

enum { FD_BIT = 8, SENT_BIT = 16, SWITCH_BIT = 32, STATE_BIT = 64 };
enum { FIRST_NAME = -2, FRAME_BYTES = 72, CLASSIC_BYTES = 16, STAMP = 4, STAMP_BYTES = 32 };
enum { HEAD = 16, HEAD_CONTROLS = 10, HEAD_FLAGS = 12, HEAD_LENGTH = 14, DONTROUTE = 4 };

KERNEL(can_frames) {
    TAKE("B2!i2!l2d1!I1!B1!B1!B1!B1!");
    Py_ssize_t frames = LENGTH(0, 0);
    double *times = ARRAY(3)->buf;
    uint32_t *ids = ARRAY(4)->buf;
    uint8_t *flags = ARRAY(5)->buf, *dlc = ARRAY(6)->buf, *sizes = ARRAY(7)->buf, *data = ARRAY(8)->buf;
    int fits = LENGTH(0, 1) == FRAME_BYTES && LENGTH(1, 1) == HEAD && LENGTH(2, 1) == STAMP && LENGTH(8, 0) == frames * FRAME_BYTES;
    for (int n = 1; n < 8; n++) fits &= LENGTH(n, 0) == frames;
    if (!sized(&given, fits)) return NULL;
    for (Py_ssize_t n = 0; n < frames; n++) {
        uint8_t *frame = ROW(uint8_t, 0, n);
        int32_t *head = ROW(int32_t, 1, n);
        const int64_t *stamp = ROW(int64_t, 2, n);
        uint32_t code;
        memcpy(&code, frame, sizeof code);
        int extended = (code & 0x80000000u) != 0, remote = (code & 0x40000000u) != 0, error = (code & 0x20000000u) != 0;
        int fd = head[HEAD_LENGTH] != CLASSIC_BYTES, sent = (head[HEAD_FLAGS] & DONTROUTE) != 0;
        uint8_t most = fd ? 64 : 8;
        times[n] = head[HEAD_CONTROLS] < STAMP_BYTES ? NAN : (double)stamp[2] + (double)stamp[3] * 1e-9;
        ids[n] = code & (extended ? 0x1FFFFFFFu : 0x7FFu);
        dlc[n] = frame[4] < most ? frame[4] : most;
        sizes[n] = remote ? 0 : dlc[n];
        flags[n] = (uint8_t)(extended * EXTENDED_BIT | remote * REMOTE_BIT | error * ERROR_BIT | fd * FD_BIT | sent * SENT_BIT |
                             (fd && frame[5] & 1) * SWITCH_BIT | (fd && frame[5] & 2) * STATE_BIT);
        memcpy(data + n * FRAME_BYTES, frame, FRAME_BYTES);
        memset(frame, 0, FRAME_BYTES);
        head[HEAD_CONTROLS] = STAMP_BYTES;
    }
    return done(&given);
}

/* Which of the batches, that begin at `starts`, has a frame. */
static Py_ssize_t batch_of(const int64_t *starts, Py_ssize_t batches, int64_t frame) {
    Py_ssize_t low = 0, high = batches;
    while (high - low > 1) {
        Py_ssize_t middle = (low + high) / 2;
        if (starts[middle] <= frame) low = middle;
        else high = middle;
    }
    return low;
}

enum { JOIN_STAMPS, JOIN_IDS, JOIN_FLAGS, JOIN_DLC, JOIN_SIZES, JOIN_BEGINS, JOIN_CHANNELS, JOIN_COLUMNS };
#define OF(type, column, b, at) (((const type *)given.list[column].array[b].buf)[at])
#define INTO(type, column) ((type *)given.array[3 + (column)].buf)

KERNEL(join_frames) {
    TAKE("l1l1l2*d1*I1*B1*B1*B1*l1*i1d1!I1!B1!B1!B1!l1!i1!l1!");
    Py_ssize_t frames = LENGTH(0, 0), batches = LENGTH(1, 0), all = 0;
    const int64_t *order = ARRAY(0)->buf, *starts = ARRAY(1)->buf, *behind = ROW(int64_t, 2, 0), *renamed = ROW(int64_t, 2, 1);
    int fits = LENGTH(2, 0) == 2 && LENGTH(2, 1) == batches;
    for (int n = 0; n <= JOIN_COLUMNS; n++) fits &= LENGTH(3 + n, 0) == frames;
    for (int n = 0; n < JOIN_COLUMNS; n++) fits &= given.list[n].count == batches;
    for (Py_ssize_t b = 0; fits && b < batches; b++) {
        Py_ssize_t some = given.list[0].array[b].shape[0];
        for (int n = 1; n < JOIN_COLUMNS; n++) fits &= given.list[n].array[b].shape[0] == some;
        fits &= starts[b] == all;
        all += some;
    }
    fits &= all == frames;
    for (Py_ssize_t n = 0; fits && n < frames; n++) fits = order[n] >= 0 && order[n] < frames;
    if (!sized(&given, fits)) return NULL;
    int64_t *batch = INTO(int64_t, JOIN_COLUMNS);
    for (Py_ssize_t n = 0; n < frames; n++) {
        Py_ssize_t b = batch_of(starts, batches, order[n]), at = order[n] - starts[b];
        batch[n] = b;
        INTO(double, JOIN_STAMPS)[n] = OF(double, JOIN_STAMPS, b, at);
        INTO(uint32_t, JOIN_IDS)[n] = OF(uint32_t, JOIN_IDS, b, at);
        for (int column = JOIN_FLAGS; column <= JOIN_SIZES; column++) INTO(uint8_t, column)[n] = OF(uint8_t, column, b, at);
        INTO(int64_t, JOIN_BEGINS)[n] = OF(int64_t, JOIN_BEGINS, b, at) + behind[b];
        int32_t channel = OF(int32_t, JOIN_CHANNELS, b, at);
        INTO(int32_t, JOIN_CHANNELS)[n] = channel <= FIRST_NAME ? (int32_t)(channel + renamed[b]) : channel;
    }
    return done(&given);
}
#undef OF
#undef INTO
