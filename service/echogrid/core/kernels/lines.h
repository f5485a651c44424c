/* Lines of recordings into columns: what stands in most lines of each format. A line of any other form, from whose first byte on the
 * caller goes on, ends the walk; so each of these takes nothing that the line readers of logs/text would read otherwise.
 *
 * All share the arguments of `lines` in reference.py and its account of what they write.
 */
#define EXTENDED_ID 0x1FFFFFFFu
#define STANDARD_ID 0x7FFu
#define END_OF_TIME 2147483648.0
#define EXACT ((int64_t)1 << 53)
enum { IS_EXTENDED = 1, IS_REMOTE = 2, IS_ERROR = 4, IS_FD = 8, IS_SENT = 16, HAS_SWITCH = 32, HAS_STATE = 64 };

typedef struct {
    const uint8_t *at, *end; /* of what is read */
    double *stamps;
    uint32_t *ids;
    uint8_t *flags, *dlc, *sizes, *data;
    int64_t *begins, *place; /* place: byte of the text, frames, lines, bytes of data so far */
    int32_t *channels;
    Py_ssize_t room, data_room;
} Lines;

typedef struct {
    double stamp;
    uint32_t id;
    uint8_t flags, dlc, size;
    int32_t channel;
} Line;

static const double POWER[19] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18};
static const uint8_t LENGTH_OF[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
static int8_t HEX[256], SIXTY_FOUR[256];

static void fill_tables(void) {
    const char *sixty_four = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    memset(HEX, -1, sizeof HEX);
    memset(SIXTY_FOUR, -1, sizeof SIXTY_FOUR);
    for (int n = 0; n < 16; n++) HEX[(uint8_t)"0123456789abcdef"[n]] = HEX[(uint8_t)"0123456789ABCDEF"[n]] = (int8_t)n;
    for (int n = 0; n < 64; n++) SIXTY_FOUR[(uint8_t)sixty_four[n]] = (int8_t)n;
}

static inline int is_end(const Lines *lines) { return lines->at == lines->end || *lines->at == '\n' || *lines->at == '\r'; }
static inline int is_blank(const Lines *lines) { return lines->at < lines->end && *lines->at == ' '; }
static inline int next_is(Lines *lines, char letter) { return lines->at < lines->end && *lines->at == (uint8_t)letter && (lines->at++, 1); }

/* Whether there was a blank; all are stepped over. */
static inline int blanks(Lines *lines) {
    const uint8_t *begin = lines->at;
    while (is_blank(lines)) lines->at++;
    return lines->at > begin;
}

/* Whether the text follows; it is stepped over. */
static inline int says(Lines *lines, const char *text, Py_ssize_t size) {
    if (lines->end - lines->at < size || memcmp(lines->at, text, size)) return 0;
    lines->at += size;
    return 1;
}

static inline int digits(Lines *lines, int most, int64_t *value) {
    int count = 0;
    *value = 0;
    for (; lines->at < lines->end && (uint8_t)(*lines->at - '0') < 10; lines->at++) {
        if (++count > most) return 0;
        *value = *value * 10 + (*lines->at - '0');
    }
    return count;
}

static inline int hex_digits(Lines *lines, int most, uint32_t *value) {
    int count = 0;
    *value = 0;
    for (; lines->at < lines->end && HEX[*lines->at] >= 0; lines->at++) {
        if (++count > most) return 0;
        *value = *value << 4 | (uint32_t)HEX[*lines->at];
    }
    return count;
}

/* A number as float() reads it: up to `most` digits, then perhaps `point` and up to `most_behind` more. */
static inline int decimals(Lines *lines, int most, int most_behind, double *value) {
    const uint8_t *begin = lines->at;
    int64_t whole, behind = 0;
    int count = digits(lines, most, &whole), fraction = 0;
    if (!count) return 0;
    if (next_is(lines, '.')) {
        fraction = digits(lines, most_behind, &behind);
        if (!fraction) return 0;
    }
    if (count + fraction <= 18) {
        whole = whole * (int64_t)POWER[fraction] + behind;
        if (whole < EXACT) {
            *value = (double)whole / POWER[fraction];
            return 1;
        }
    }
    char text[64], *stopped;
    Py_ssize_t size = lines->at - begin;
    if (size >= (Py_ssize_t)sizeof text) return 0;
    memcpy(text, begin, size);
    text[size] = 0;
    *value = PyOS_string_to_double(text, &stopped, NULL);
    if (*value == -1.0 && PyErr_Occurred()) {
        PyErr_Clear();
        return 0;
    }
    return stopped == text + size;
}

/* `size` bytes as two digits each, `step` letters from one to the next, with blanks between where that is 3. */
static inline int payload(Lines *lines, Py_ssize_t size, int step) {
    uint8_t *out = lines->data + lines->place[3];
    if (!size) return 1;
    if (lines->end - lines->at < step * (size - 1) + 2) return 0;
    int wrong = 0;
    const uint8_t *at = lines->at;
    for (Py_ssize_t n = 0; n < size; n++, at += step) {
        int high = HEX[at[0]], low = HEX[at[1]];
        wrong |= high | low;
        if (step == 3 && n) wrong |= -(at[-1] != ' ');
        out[n] = (uint8_t)((uint32_t)high << 4 | (uint32_t)low);
    }
    lines->at += step * (size - 1) + 2;
    return wrong >= 0;
}

static inline int way(Lines *lines, Line *line) {
    if (says(lines, "Rx", 2)) return 1;
    line->flags |= IS_SENT;
    return says(lines, "Tx", 2);
}

/* Writes what was read of a line that ends here, or steps back to its begin. */
static inline int taken(Lines *lines, const Line *line, const uint8_t *begin, int whole) {
    int64_t n = lines->place[1];
    if (!whole || !is_end(lines) || !(line->stamp < END_OF_TIME) || line->id > (line->flags & IS_EXTENDED ? EXTENDED_ID : STANDARD_ID)) {
        lines->at = begin;
        return 0;
    }
    lines->stamps[n] = line->stamp;
    lines->ids[n] = line->id;
    lines->flags[n] = line->flags;
    lines->dlc[n] = line->dlc;
    lines->sizes[n] = line->size;
    lines->begins[n] = lines->place[3];
    lines->channels[n] = line->channel;
    if (next_is(lines, '\r'))
        next_is(lines, '\n');
    else
        next_is(lines, '\n');
    lines->place[1]++;
    lines->place[2]++;
    lines->place[3] += line->size;
    return 1;
}

static inline int has_room(const Lines *lines) {
    return lines->at < lines->end && lines->place[1] < lines->room && lines->place[3] + 64 <= lines->data_room;
}

/* Arguments 0 to 9: text, place, stamps, ids, flags, dlc, sizes, begins, data, channels. */
#define LINES_SPEC "B1l1!d1!I1!B1!B1!B1!l1!B1!i1!"
static int open_lines(Given *given, Lines *lines) {
    lines->place = given->array[1].buf;
    lines->room = given->array[2].shape[0];
    lines->data_room = given->array[8].shape[0];
    int fits = given->array[1].shape[0] == 4;
    for (int n = 3; n < 10; n++) fits &= n == 8 || given->array[n].shape[0] == lines->room;
    if (!sized(given, fits && lines->place[0] >= 0 && lines->place[0] <= given->array[0].shape[0])) return 0;
    lines->at = (const uint8_t *)given->array[0].buf + lines->place[0];
    lines->end = (const uint8_t *)given->array[0].buf + given->array[0].shape[0];
    lines->stamps = given->array[2].buf;
    lines->ids = given->array[3].buf;
    lines->flags = given->array[4].buf;
    lines->dlc = given->array[5].buf;
    lines->sizes = given->array[6].buf;
    lines->begins = given->array[7].buf;
    lines->data = given->array[8].buf;
    lines->channels = given->array[9].buf;
    return 1;
}

static PyObject *close_lines(Given *given, Lines *lines) {
    lines->place[0] = lines->at - (const uint8_t *)given->array[0].buf;
    return done(given);
}

/* Which of the names follows, -1 for none of them; it is looked for from the one before on. */
static int32_t name(Lines *lines, const Given *given, int32_t before) {
    const uint8_t *begin = lines->at;
    int32_t names = (int32_t)given->array[10].shape[0];
    Py_ssize_t width = given->array[10].shape[1];
    while (lines->at < lines->end && *lines->at > ' ') lines->at++;
    Py_ssize_t size = lines->at - begin;
    if (!size || size > width) return -1;
    for (int32_t n = 0; n < names; n++) {
        int32_t one = n + before < names ? n + before : n + before - names;
        const uint8_t *there = (const uint8_t *)given->array[10].buf + one * given->array[10].strides[0];
        if (!memcmp(begin, there, size) && (size == width || !there[size])) return one;
    }
    return -1;
}

KERNEL(candump_lines) {
    TAKE(LINES_SPEC "B2");
    Lines lines;
    if (!open_lines(&given, &lines)) return NULL;
    int32_t channel = 0;
    while (has_room(&lines)) {
        const uint8_t *begin = lines.at, *digit;
        Line line = {0};
        blanks(&lines);
        int whole = next_is(&lines, '(') && (digit = lines.at, decimals(&lines, 12, 9, &line.stamp)) && lines.at - digit >= 3 &&
                    next_is(&lines, ')') && blanks(&lines) && (channel = name(&lines, &given, channel)) >= 0 && blanks(&lines);
        channel = channel < 0 ? 0 : channel;
        int length = whole ? hex_digits(&lines, 8, &line.id) : 0;
        whole = whole && length >= 3 && next_is(&lines, '#');
        line.flags = length > 3 ? IS_EXTENDED : 0;
        if (whole && next_is(&lines, '#')) {
            uint32_t bits;
            whole = lines.at < lines.end && HEX[*lines.at] >= 0;
            bits = whole ? (uint32_t)HEX[*lines.at++] : 0;
            line.flags |= IS_FD | (bits & 1 ? HAS_SWITCH : 0) | (bits & 2 ? HAS_STATE : 0);
        }
        if (whole) {
            const uint8_t *last = lines.at;
            while (last < lines.end && HEX[*last] >= 0) last++;
            Py_ssize_t letters = last - lines.at;
            whole = letters % 2 == 0 && letters / 2 <= (line.flags & IS_FD ? 64 : 8) && payload(&lines, letters / 2, 2);
            line.size = line.dlc = (uint8_t)(letters / 2);
        }
        if (whole && blanks(&lines) && !is_end(&lines)) {
            if (next_is(&lines, 'T'))
                line.flags |= IS_SENT;
            else
                whole = next_is(&lines, 'R');
            blanks(&lines);
        }
        line.channel = -2 - channel;
        if (!taken(&lines, &line, begin, whole)) break;
    }
    return close_lines(&given, &lines);
}

/* One after the other: whether a word of a CANFD line begins what all of them end with: two bits, code, length. */
static int fd_lengths(Lines *lines, Line *line, uint32_t *code, int64_t *count) {
    for (int n = 0; n < 2; n++) {
        if (lines->at == lines->end || (*lines->at != '0' && *lines->at != '1')) return 0;
        line->flags = (uint8_t)((line->flags & ~(n ? HAS_STATE : HAS_SWITCH)) | (*lines->at == '1' ? (n ? HAS_STATE : HAS_SWITCH) : 0));
        lines->at++;
        if (!blanks(lines)) return 0;
    }
    return hex_digits(lines, 2, code) && blanks(lines) && digits(lines, 2, count) && (is_blank(lines) || is_end(lines));
}

/* To the end of a word of ASCII; what other letters are blanks is the line readers' business. */
static inline void to_blank(Lines *lines) {
    while (lines->at < lines->end && *lines->at > ' ' && *lines->at < 0x7F) lines->at++;
}

static int asc_fd(Lines *lines, Line *line) {
    int64_t channel, count = 0;
    uint32_t code = 0, flags = 0x1000;
    if (!blanks(lines) || !digits(lines, 3, &channel) || !blanks(lines) || !way(lines, line) || !blanks(lines) || !hex_digits(lines, 8, &line->id))
        return 0;
    line->channel = (int32_t)channel;
    if (next_is(lines, 'x')) line->flags |= IS_EXTENDED;
    if (!blanks(lines)) return 0;
    const uint8_t *word = lines->at;
    if (!fd_lengths(lines, line, &code, &count)) {
        lines->at = word;
        to_blank(lines);
        if (!blanks(lines) || !fd_lengths(lines, line, &code, &count)) return 0;
    }
    if (count > 64 || (count && !(blanks(lines) && payload(lines, count, 3)))) return 0;
    int behind = 0;
    for (; behind < 3; behind++) {
        if (!blanks(lines) || is_end(lines)) break;
        if (behind < 2)
            to_blank(lines);
        else if (!hex_digits(lines, 8, &flags) || !(is_end(lines) || is_blank(lines)))
            return 0;
    }
    if (!is_end(lines) && !is_blank(lines)) return 0;
    if (flags & 0x10 || (!count && (!(flags & 0x1000) || behind < 3))) return 0; /* it may be a remote frame */
    line->flags |= flags & 0x1000 ? IS_FD : 0;
    line->size = line->dlc = (uint8_t)count;
    return 1;
}

static int asc_classic(Lines *lines, Line *line) {
    int64_t channel, size;
    if (!digits(lines, 3, &channel) || !blanks(lines) || !hex_digits(lines, 8, &line->id)) return 0;
    line->channel = (int32_t)channel;
    if (next_is(lines, 'x')) line->flags |= IS_EXTENDED;
    if (!blanks(lines) || !way(lines, line) || !blanks(lines) || !next_is(lines, 'd') || !blanks(lines)) return 0;
    if (!digits(lines, 1, &size) || size > 8 || (size && !(blanks(lines) && payload(lines, size, 3)))) return 0;
    line->size = line->dlc = (uint8_t)size;
    return is_end(lines) || is_blank(lines);
}

KERNEL(asc_lines) {
    TAKE(LINES_SPEC "l1!xx");
    Lines lines;
    if (!open_lines(&given, &lines)) return NULL;
    int64_t *clock = given.array[10].buf; /* ns: the newest time as it stands, and of relative ones their sum */
    int relative = given.number[0] != 0;
    double origin = given.number[1];
    if (!sized(&given, given.array[10].shape[0] == 1)) return NULL;
    while (has_room(&lines)) {
        const uint8_t *begin = lines.at;
        Line line = {0};
        int64_t seconds, behind = 0;
        blanks(&lines);
        int whole = digits(&lines, 10, &seconds) && next_is(&lines, '.'), fraction = whole ? digits(&lines, 9, &behind) : 0;
        whole = whole && fraction && seconds < (int64_t)END_OF_TIME && blanks(&lines);
        int64_t raw = whole ? seconds * 1000000000 + behind * (int64_t)POWER[9 - fraction] + (relative ? clock[0] : 0) : 0;
        line.stamp = (double)raw / 1e9 + origin;
        whole = whole && (says(&lines, "CANFD", 5) ? asc_fd(&lines, &line) : asc_classic(&lines, &line));
        while (whole && !is_end(&lines)) lines.at++;
        if (!taken(&lines, &line, begin, whole)) break;
        clock[0] = raw;
    }
    return close_lines(&given, &lines);
}

static int trc_kind(Lines *lines, Line *line) {
    if (says(lines, "DT", 2)) return 1;
    line->flags |= IS_FD;
    if (says(lines, "FD", 2)) return 1;
    if (says(lines, "FB", 2)) return line->flags |= HAS_SWITCH;
    if (says(lines, "FE", 2)) return line->flags |= HAS_SWITCH | HAS_STATE;
    return says(lines, "BI", 2) && (line->flags |= HAS_STATE);
}

/* One word of a column; `size` is that of the data once its column was read. */
static int trc_word(Lines *lines, uint8_t column, Line *line, double start, int64_t *size) {
    int64_t number;
    switch (column) {
    case 'O':
        if (!decimals(lines, 13, 6, &line->stamp)) return 0;
        line->stamp = start + line->stamp / 1000;
        break;
    case 'T':
        if (!trc_kind(lines, line)) return 0;
        break;
    case 'B':
        if (!digits(lines, 9, &number)) return 0;
        line->channel = (int32_t)number;
        break;
    case 'I': {
        int letters = hex_digits(lines, 8, &line->id);
        if (!letters) return 0;
        line->flags |= letters > 4 ? IS_EXTENDED : 0;
        break;
    }
    case 'd':
        if (!way(lines, line)) return 0;
        break;
    case 'L':
    case 'l':
        if (!digits(lines, 2, size) || *size > (column == 'l' ? 64 : 15)) return 0;
        *size = column == 'l' ? *size : LENGTH_OF[*size];
        break;
    default:
        to_blank(lines);
    }
    return is_end(lines) || is_blank(lines);
}

KERNEL(trc_lines) {
    TAKE(LINES_SPEC "B1x");
    Lines lines;
    if (!open_lines(&given, &lines)) return NULL;
    const uint8_t *columns = given.array[10].buf;
    Py_ssize_t count_of_columns = given.array[10].shape[0]; /* the last of them, 'D', has the rest of the line */
    while (has_room(&lines) && count_of_columns) {
        const uint8_t *begin = lines.at;
        Line line = {.channel = -1};
        int64_t size = -1;
        blanks(&lines);
        int whole = lines.at < lines.end && (uint8_t)(*lines.at - '0') < 10;
        for (Py_ssize_t n = 0; whole && n + 1 < count_of_columns; n++) {
            whole = !is_end(&lines) && trc_word(&lines, columns[n], &line, given.number[0], &size);
            blanks(&lines);
        }
        if (whole && !(line.flags & IS_FD) && size > 8) size = 8;
        whole = whole && size >= 0 && payload(&lines, size, 3);
        blanks(&lines);
        line.size = line.dlc = (uint8_t)size;
        if (!taken(&lines, &line, begin, whole)) break;
    }
    return close_lines(&given, &lines);
}

/* Base 64 up to the line's end; -1 where it is not sound, or more than 64 bytes. */
static Py_ssize_t sixty_four(Lines *lines) {
    const uint8_t *begin = lines->at, *at = begin;
    uint8_t *out = lines->data + lines->place[3];
    Py_ssize_t size = 0;
    while (at < lines->end && SIXTY_FOUR[*at] >= 0) at++;
    Py_ssize_t letters = at - begin, padding = -letters & 3;
    if (padding == 3 || letters > 86) return -1;
    for (Py_ssize_t n = 0; n + 1 < letters; n += 4) {
        uint32_t bits = 0, more = letters - n < 4 ? (uint32_t)(letters - n) : 4;
        for (uint32_t k = 0; k < 4; k++) bits = bits << 6 | (k < more ? (uint32_t)SIXTY_FOUR[begin[n + k]] : 0);
        uint32_t left = bits & ((1u << 8 * (4 - more)) - 1);
        if (more < 4 && left) return -1;
        for (uint32_t k = 0; k + 1 < more; k++) out[size++] = (uint8_t)(bits >> (16 - 8 * k));
    }
    lines->at = at;
    while (padding--)
        if (!next_is(lines, '=')) return -1;
    return size;
}

KERNEL(csv_lines) {
    TAKE(LINES_SPEC);
    Lines lines;
    if (!open_lines(&given, &lines)) return NULL;
    while (has_room(&lines)) {
        const uint8_t *begin = lines.at;
        Line line = {.flags = IS_EXTENDED, .channel = -1};
        int64_t length = 0;
        int whole = decimals(&lines, 10, 12, &line.stamp) && says(&lines, ",0x", 3) && hex_digits(&lines, 8, &line.id) &&
                    line.id <= EXTENDED_ID;
        int wide = whole && says(&lines, ",1,0,0,", 7);
        whole = whole && (wide || says(&lines, ",0,0,0,", 7)) && digits(&lines, 2, &length) && next_is(&lines, ',');
        Py_ssize_t size = whole ? sixty_four(&lines) : -1;
        whole = size >= 0 && size <= 64 && (length == size || (length < 16 && LENGTH_OF[length] == size));
        line.size = line.dlc = (uint8_t)size;
        if (!taken(&lines, &line, begin, whole)) break;
        if (!wide) lines.flags[lines.place[1] - 1] = 0;
    }
    return close_lines(&given, &lines);
}

static inline uint32_t word_at(const uint8_t *at) { return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24; }

KERNEL(blf_objects) {
    TAKE("B1l1!l1!l1!B1xxx");
    const uint8_t *data = given.array[0].buf, *wanted = given.array[4].buf;
    int64_t *place = given.array[1].buf, *places = given.array[2].buf, *kinds = given.array[3].buf;
    Py_ssize_t end = given.array[0].shape[0], room = given.array[2].shape[0], known = given.array[4].shape[0];
    Py_ssize_t base = (Py_ssize_t)given.number[0], most = (Py_ssize_t)given.number[1], most_wanted = (Py_ssize_t)given.number[2];
    if (!sized(&given, given.array[1].shape[0] == 2 && given.array[3].shape[0] == room && place[0] >= 0 && place[1] >= 0 && base >= 16)) return NULL;
    Py_ssize_t at = place[0];
    while (end - at >= base && place[1] < room) {
        Py_ssize_t filled = 0; /* an object may be filled up with as much */
        while (filled < 4 && end - at - filled >= base && memcmp(data + at + filled, "LOBJ", 4)) filled++;
        if (filled == 4 || end - at - filled < base) break;
        const uint8_t *object = data + at + filled;
        uint32_t header = (uint32_t)object[4] | (uint32_t)object[5] << 8, size = word_at(object + 8), kind = word_at(object + 12);
        if (header < base || header > size || size > most || kind >= known || (wanted[kind] && size > most_wanted)) break;
        if (size > end - at - filled) break;
        places[place[1]] = at + filled;
        kinds[place[1]++] = kind;
        at += filled + size;
    }
    place[0] = at;
    return done(&given);
}
