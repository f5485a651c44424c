/* The hot loops of echogrid, compiled: each does what the function of its name in reference.py does, bit for bit.
 *
 * What they are for, shapes and units stand there. Arrays come by the buffer protocol and are checked for type, dimensions and rows without
 * gaps; results are written into arrays of the caller's. No loop calls exp or its like, whose last bits differ between libraries: but for
 * sin and cos of a few poses, which are those that Python's math calls. No product is fused with a sum (-ffp-contract=off). The limited API: one file serves every Python from 3.11 on.
 */
#define Py_LIMITED_API 0x030b0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define MOST 24
#define MOST_LISTS 7
#define SIDE 128 /* cells along a tile's side */
#define LITTLE (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__)

typedef struct {
    Py_buffer *array;
    Py_ssize_t count;
} List;

typedef struct {
    Py_buffer array[MOST];
    int arrays;
    double number[MOST];
    int numbers;
    List list[MOST_LISTS];
    int lists;
} Given;

static void drop(Given *given) {
    while (given->arrays)
        PyBuffer_Release(&given->array[--given->arrays]);
    while (given->lists) {
        List *list = &given->list[--given->lists];
        while (list->count) PyBuffer_Release(&list->array[--list->count]);
        free(list->array);
    }
}

/* Size of an element whose format's last letter fits the kind; 0 where it does not. */
static Py_ssize_t fitting(char kind, const char *format) {
    char found = format == NULL || !*format ? 'B' : format[strlen(format) - 1];
    switch (kind) {
    case 'd': return found == 'd' ? 8 : 0;
    case 'f': return found == 'f' ? 4 : 0;
    case 'Q': return found == 'L' || found == 'Q' ? 8 : 0;
    case 'l': return found == 'l' || found == 'q' ? 8 : 0;
    case 'i': return found == 'i' ? 4 : 0;
    case 'I': return found == 'I' ? 4 : 0;
    case 'H': return found == 'H' ? 2 : 0;
    case 'b': return found == 'b' ? 1 : 0;
    default: return found == 'B' || found == '?' ? 1 : 0;
    }
}

/* An array of a kind and so many dimensions, without gaps in a row. */
static int take_array(Py_buffer *array, PyObject *object, Py_ssize_t at, char kind, int dimensions, int written) {
    if (PyObject_GetBuffer(object, array, PyBUF_FORMAT | PyBUF_STRIDES | (written ? PyBUF_WRITABLE : 0))) return 0;
    int gaps = array->ndim > 0 && array->shape[array->ndim - 1] > 1 && array->strides[array->ndim - 1] != array->itemsize;
    if (array->ndim == dimensions && fitting(kind, array->format) == array->itemsize && !gaps) return 1;
    PyErr_Format(PyExc_TypeError, "argument %zd: expected %d dimensions of '%c' without gaps in a row, found %d of '%s'", at + 1, dimensions, kind,
                 array->ndim, array->format ? array->format : "B");
    PyBuffer_Release(array);
    return 0;
}

static int take_list(List *list, PyObject *object, Py_ssize_t at, char kind, int dimensions, int written) {
    Py_ssize_t count = PyList_Check(object) ? PyList_Size(object) : -1;
    list->count = 0;
    list->array = malloc((count > 0 ? count : 1) * sizeof *list->array);
    if (list->array == NULL) {
        PyErr_NoMemory();
        return 0;
    }
    if (count < 0) PyErr_Format(PyExc_TypeError, "argument %zd: expected a list of arrays", at + 1);
    while (list->count < count && take_array(&list->array[list->count], PyList_GetItem(object, list->count), at, kind, dimensions, written)) list->count++;
    return list->count == count;
}

/* `spec`: for each argument "x" for a number, or the kind and dimensions of an array, "!" after one that is written, "*" before a list of such. */
static int take(Given *given, const char *spec, PyObject *const *arguments, Py_ssize_t count) {
    given->arrays = given->numbers = given->lists = 0;
    Py_ssize_t at = 0, expected = 0;
    for (const char *s = spec; *s; s++) expected += *s == 'x' || (*s >= '0' && *s <= '9');
    if (count != expected) {
        PyErr_Format(PyExc_TypeError, "%zd arguments do not fit '%s'", count, spec);
        return 0;
    }
    for (const char *s = spec; *s; at++) {
        if (*s == 'x') {
            double number = PyFloat_AsDouble(arguments[at]);
            if (number == -1.0 && PyErr_Occurred()) goto wrong;
            given->number[given->numbers++] = number;
            s++;
            continue;
        }
        int several = *s == '*';
        s += several;
        char kind = *s++;
        int dimensions = *s++ - '0', written = *s == '!';
        s += written;
        if (several) {
            if (!take_list(&given->list[given->lists++], arguments[at], at, kind, dimensions, written)) goto wrong;
        } else if (take_array(&given->array[given->arrays], arguments[at], at, kind, dimensions, written)) given->arrays++;
        else goto wrong;
    }
    return 1;
wrong:
    drop(given);
    return 0;
}

static int sized(Given *given, int ok) {
    if (!ok) {
        PyErr_SetString(PyExc_ValueError, "the arrays' shapes do not belong together");
        drop(given);
    }
    return ok;
}

static PyObject *done(Given *given) {
    drop(given);
    Py_RETURN_NONE;
}

/* Loops that gain from wider registers, with the same results: chosen when the module is loaded. None may turn points that lie as pairs,
 * x and y: of c * x - s * y beside s * x + c * y gcc 12 makes vfmaddsub there, whatever -ffp-contract says. */
#if defined(__x86_64__) && defined(__GLIBC__) && !defined(__clang__) && __GNUC__ >= 12
#define WIDE __attribute__((target_clones("arch=x86-64-v4", "avx2", "default")))
#elif defined(__x86_64__) && defined(__GLIBC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

/* Cells that are worked on together; points that a loop takes in one step; cells that are fetched before they are needed. */
enum { BLOCK = 64, LANES = 16, AHEAD = 16 };

#define ARRAY(n) (&given.array[n])
#define ROW(type, n, i) ((type *)((char *)given.array[n].buf + (i) * given.array[n].strides[0]))
#define ROW3(type, n, p, i) ((type *)((char *)given.array[n].buf + (p) * given.array[n].strides[0] + (i) * given.array[n].strides[1]))
#define LENGTH(n, axis) (given.array[n].shape[axis])
#define KERNEL(name) static PyObject *name(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
#define TAKE(spec)   \
    Given given;     \
    (void)self;      \
    if (!take(&given, spec, arguments, count)) return NULL

static inline int64_t floored(double x) {
    int64_t whole = (int64_t)x;
    return whole - (x < (double)whole);
}

/* Flat cell of a patch around the middle, -1 outside and for what is no number. */
static inline Py_ssize_t patch_cell(double x, double y, double half, double cell, Py_ssize_t cells) {
    double column = (x + half) / cell, row = (y + half) / cell;
    if (!(column >= 0 && column < (double)cells && row >= 0 && row < (double)cells)) return -1;
    return (Py_ssize_t)row * cells + (Py_ssize_t)column;
}

static inline uint8_t byte_of_rcs(double rcs) {
    if (isnan(rcs)) return 0;
    double value = rint(128 + 4 * rcs);
    return (uint8_t)(value < 1 ? 1 : value > 255 ? 255 : value);
}

static inline uint8_t byte_within(double value) { return (uint8_t)(value < 1 ? 1 : value > 255 ? 255 : value); }

static inline void raise_to(uint8_t *place, uint8_t value) {
    if (value > *place) *place = value;
}

/* One more at a place; `out` has the table's byte for how many there are. */
static inline void count_one(uint8_t *counts, const uint8_t *table, uint8_t *out, Py_ssize_t at) {
    counts[at] += counts[at] < 255;
    out[at] = table[counts[at]];
}

KERNEL(moved) {
    TAKE("d2xxxxd2!");
    Py_ssize_t size = LENGTH(0, 0);
    if (!sized(&given, LENGTH(0, 1) == 2 && LENGTH(1, 0) == size && LENGTH(1, 1) == 2)) return NULL;
    double x = given.number[0], y = given.number[1], c = given.number[2], s = given.number[3];
    for (Py_ssize_t n = 0; n < size; n++) {
        const double *from = ROW(double, 0, n);
        double *to = ROW(double, 1, n), there = c * from[0] - s * from[1] + x;
        to[1] = s * from[0] + c * from[1] + y;
        to[0] = there;
    }
    return done(&given);
}

/* Whether sizes are those of so many scans, which have so many detections in all. */
static int sizes_fit(const Given *given, int sizes, Py_ssize_t scans, Py_ssize_t detections) {
    const int64_t *size = given->array[sizes].buf;
    int64_t left = detections;
    int fits = given->array[sizes].shape[0] == scans;
    for (Py_ssize_t s = 0; fits && s < scans; s++) {
        fits = size[s] >= 0 && size[s] <= left;
        left -= size[s];
    }
    return fits && left == 0;
}

KERNEL(draw_now) {
    TAKE("d2d1d1xxB1B3!");
    Py_ssize_t size = LENGTH(0, 0), side = LENGTH(4, 1), cells = side * side;
    if (!sized(&given, LENGTH(0, 1) == 2 && LENGTH(1, 0) == size && LENGTH(2, 0) == size && LENGTH(3, 0) == 256 && LENGTH(4, 0) == 3 &&
                           LENGTH(4, 2) == side && ARRAY(4)->strides[1] == side && ARRAY(4)->strides[0] == cells))
        return NULL;
    const double *rcs = ARRAY(1)->buf, *deviation = ARRAY(2)->buf;
    const uint8_t *table = ARRAY(3)->buf;
    uint8_t *out = ARRAY(4)->buf, *counts = calloc(cells, 1);
    if (counts == NULL) {
        drop(&given);
        return PyErr_NoMemory();
    }
    memset(out, table[0], cells);
    memset(out + cells, 0, 2 * cells);
    for (Py_ssize_t n = 0; n < size; n++) {
        const double *point = ROW(double, 0, n);
        Py_ssize_t at = patch_cell(point[0], point[1], given.number[0], given.number[1], side);
        if (at < 0) continue;
        count_one(counts, table, out, at);
        raise_to(out + cells + at, byte_of_rcs(rcs[n]));
        raise_to(out + 2 * cells + at, byte_within(255 - 60 * deviation[n]));
    }
    free(counts);
    return done(&given);
}

/* What the points of the past make of a cell: counts up to `close` and `middle` m, of all, and of updates. */
typedef struct {
    uint16_t last; /* update that had a point here, from 1 */
    uint8_t counts[4], recency, rcs;
} Past;

static inline void one_more(uint8_t *count, int counts) { *count += counts & (*count < 255); }

/* Of so many points, a block at most: cells of the patch, -1 outside, and bytes of how recent and how strong they are. */
WIDE static void past_block(const double *point, const double *age, const double *rcs, Py_ssize_t size, double half, double cell, int32_t side,
                            double fading, int32_t *at, uint8_t *recency, uint8_t *strength) {
    for (Py_ssize_t n = 0; n < size; n++) {
        double column = (point[2 * n] + half) / cell, row = (point[2 * n + 1] + half) / cell;
        int inside = (column >= 0) & (column < side) & (row >= 0) & (row < side);
        at[n] = inside ? (int32_t)row * side + (int32_t)column : -1;
    }
    for (Py_ssize_t n = 0; n < size; n++) {
        double recent = 255 - age[n] * fading, strong = rint(128 + 4 * rcs[n]);
        recent = recent > 1 ? recent : 1;
        recency[n] = (uint8_t)(int32_t)(recent < 255 ? recent : 255);
        strong = strong < 1 ? 1 : strong;
        strong = strong > 255 ? 255 : strong;
        strength[n] = (uint8_t)(int32_t)(rcs[n] == rcs[n] ? strong : 0);
    }
}

KERNEL(draw_past) {
    TAKE("d2d1l1d1xxxxxB1B3!");
    Py_ssize_t size = LENGTH(0, 0), side = LENGTH(5, 1), cells = side * side;
    const double *point = ARRAY(0)->buf, *age = ARRAY(1)->buf, *rcs = ARRAY(3)->buf;
    const int64_t *update = ARRAY(2)->buf;
    if (!sized(&given, LENGTH(0, 1) == 2 && (size == 0 || ARRAY(0)->strides[0] == 2 * sizeof *point) && LENGTH(1, 0) == size && LENGTH(2, 0) == size &&
                           LENGTH(3, 0) == size && (size == 0 || update[size - 1] - update[0] < UINT16_MAX) && LENGTH(4, 0) == 256 &&
                           LENGTH(5, 0) == 6 && LENGTH(5, 2) == side && ARRAY(5)->strides[1] == side && ARRAY(5)->strides[0] == cells))
        return NULL;
    const uint8_t *table = ARRAY(4)->buf;
    uint8_t *out = ARRAY(5)->buf, recency[BLOCK], strength[BLOCK];
    int32_t at[BLOCK];
    double half = given.number[0], cell = given.number[1], close = given.number[2], middle = given.number[3], fading = given.number[4];
    Past *past = calloc(cells, sizeof *past);
    int32_t *drawn = malloc((size + 1) * sizeof *drawn);
    if (past == NULL || drawn == NULL) {
        free(past);
        free(drawn);
        drop(&given);
        return PyErr_NoMemory();
    }
    Py_ssize_t found = 0;
    for (Py_ssize_t from = 0; from < size; from += BLOCK) {
        Py_ssize_t some = size - from < BLOCK ? size - from : BLOCK;
        past_block(point + 2 * from, age + from, rcs + from, some, half, cell, (int32_t)side, fading, at, recency, strength);
        for (Py_ssize_t k = 0; k < some; k++) {
            if (at[k] < 0) continue;
            Past *here = past + at[k];
            uint16_t number = (uint16_t)(update[from + k] - update[0] + 1);
            if (!here->counts[2]) drawn[found++] = at[k];
            one_more(&here->counts[0], age[from + k] <= close);
            one_more(&here->counts[1], age[from + k] <= middle);
            one_more(&here->counts[2], 1);
            one_more(&here->counts[3], here->last != number);
            here->last = number;
            raise_to(&here->recency, recency[k]);
            raise_to(&here->rcs, strength[k]);
        }
    }
    memset(out, table[0], 4 * cells);
    memset(out + 4 * cells, 0, 2 * cells);
    for (Py_ssize_t n = 0; n < found; n++) {
        const Past *here = past + drawn[n];
        uint8_t *to = out + drawn[n];
        for (int k = 0; k < 4; k++) to[k * cells] = table[here->counts[k]];
        to[4 * cells] = here->recency;
        to[5 * cells] = here->rcs;
    }
    free(past);
    free(drawn);
    return done(&given);
}

/* Writes the table's bytes of counts of blocks into all cells of each block. */
static void spread(const int32_t *counts, const uint8_t *table, uint8_t *out, Py_ssize_t blocks, Py_ssize_t along) {
    Py_ssize_t side = blocks * along;
    for (Py_ssize_t i = 0; i < blocks; i++) {
        uint8_t *first = out + i * along * side;
        for (Py_ssize_t j = 0; j < blocks; j++) {
            int32_t found = counts[i * blocks + j];
            memset(first + j * along, table[found > 255 ? 255 : found], along);
        }
        for (Py_ssize_t k = 1; k < along; k++) memcpy(first + k * side, first, side);
    }
}

/* Blocks that the first points of a ray lie in, `reached` m on, `blocks` squared for those outside; whole LANES of points. */
WIDE static void along_ray(Py_ssize_t points, const float *reached, float x, float y, float dx, float dy, float length, float half, float step,
                           int32_t blocks, int32_t *out) {
    for (Py_ssize_t k = 0; k < points; k += LANES)
        for (Py_ssize_t n = k; n < k + LANES; n++) {
            float share = reached[n] / length, column = (x + share * dx + half) / step, row = (y + share * dy + half) / step;
            int inside = (column >= 0) & (column < (float)blocks) & (row >= 0) & (row < (float)blocks);
            out[n] = inside ? (int32_t)row * blocks + (int32_t)column : blocks * blocks;
        }
}

KERNEL(draw_passes) {
    TAKE("f2f2f1xxxxB1B2!");
    Py_ssize_t rays = LENGTH(0, 0), side = LENGTH(4, 0), along = (Py_ssize_t)given.number[3], blocks = along > 0 ? side / along : 0;
    if (!sized(&given, LENGTH(1, 0) == rays && LENGTH(2, 0) == rays && LENGTH(0, 1) == 2 && LENGTH(1, 1) == 2 && LENGTH(3, 0) == 256 &&
                           blocks * along == side && LENGTH(4, 1) == side && ARRAY(4)->strides[0] == side && given.number[2] >= 0))
        return NULL;
    const float *distance = ARRAY(2)->buf;
    float half = (float)given.number[0], step = (float)given.number[1], margin = (float)given.number[2];
    float longest = 0;
    for (Py_ssize_t n = 0; n < rays; n++) longest = distance[n] > longest ? distance[n] : longest;
    Py_ssize_t most = isfinite(longest) ? (Py_ssize_t)(longest / step) + 2 + LANES : 0;
    int32_t *counts = calloc(blocks * blocks + 1, sizeof *counts), *passed = malloc(most * sizeof *passed);
    float *reached = malloc(most * sizeof *reached);
    if (counts == NULL || passed == NULL || reached == NULL || !most) {
        free(counts);
        free(passed);
        free(reached);
        drop(&given);
        return PyErr_NoMemory();
    }
    for (Py_ssize_t k = 0; k < most; k++) reached[k] = (0.5f + (float)(int32_t)k) * step;
    for (Py_ssize_t n = 0; n < rays; n++) {
        const float *origin = ROW(float, 0, n), *way = ROW(float, 1, n);
        float limit = distance[n] - margin, length = distance[n] > 1e-3f ? distance[n] : 1e-3f;
        Py_ssize_t points = limit > 0 ? (Py_ssize_t)(limit / step) : 0; /* about as many: */
        while (points > 0 && !(reached[points - 1] < limit)) points--;
        while (reached[points] < limit) points++;
        along_ray(points, reached, origin[0], origin[1], way[0], way[1], length, half, step, (int32_t)blocks, passed);
        for (Py_ssize_t k = 0; k < points; k++) counts[passed[k]]++;
    }
    spread(counts, ARRAY(3)->buf, ARRAY(4)->buf, blocks, along);
    free(counts);
    free(passed);
    free(reached);
    return done(&given);
}

WIDE static void count_seen(const float *squares, const float *products, float square, float product, float reach, float least, Py_ssize_t blocks,
                            int32_t *counts) {
    for (Py_ssize_t j = 0; j < blocks; j++) {
        float distance = sqrtf(squares[j] + square);
        counts[j] += (distance <= reach) & (products[j] + product >= distance * least);
    }
}

KERNEL(draw_looks) {
    TAKE("f2f1B1B2!");
    Py_ssize_t scans = LENGTH(0, 0), blocks = LENGTH(1, 0), side = LENGTH(3, 0);
    if (!sized(&given, LENGTH(0, 1) == 6 && LENGTH(2, 0) == 256 && blocks > 0 && side % blocks == 0 && LENGTH(3, 1) == side &&
                           ARRAY(3)->strides[0] == side))
        return NULL;
    const float *middle = ARRAY(1)->buf;
    int32_t *counts = calloc(blocks * blocks, sizeof *counts);
    float *along = malloc(2 * blocks * sizeof *along);
    if (counts == NULL || along == NULL) {
        free(counts);
        free(along);
        drop(&given);
        return PyErr_NoMemory();
    }
    Py_BEGIN_ALLOW_THREADS;
    for (Py_ssize_t n = 0; n < scans; n++) {
        const float *scan = ROW(float, 0, n); /* x, y, cos and sin of yaw, range, cosine of half the field of view */
        float reach = scan[4], least = scan[5], *squares = along, *products = along + blocks;
        for (Py_ssize_t j = 0; j < blocks; j++) {
            float dx = middle[j] - scan[0];
            squares[j] = dx * dx;
            products[j] = dx * scan[2];
        }
        for (Py_ssize_t i = 0; i < blocks; i++) {
            float dy = middle[i] - scan[1], square = dy * dy, product = dy * scan[3];
            count_seen(squares, products, square, product, reach, least, blocks, counts + i * blocks);
        }
    }
    Py_END_ALLOW_THREADS;
    spread(counts, ARRAY(2)->buf, ARRAY(3)->buf, blocks, side / blocks);
    free(counts);
    free(along);
    return done(&given);
}

typedef struct {
    int64_t row, column, size; /* of the first cell in the map, and along a side */
    double cell, inverse, shift; /* of points, before they are divided into cells */
} Window;

/* floor(x / cell): by its inverse, except where that lies so near to a whole number that the quotient might be on the other side of it. */
static inline int64_t floored_quotient(double x, const Window *window) {
    double quotient = x * window->inverse, whole = (double)floored(quotient), beyond = quotient - whole;
    if (!(beyond > 1e-6 && beyond < 1 - 1e-6) || !(fabs(quotient) < 1e6)) return floored(x / window->cell);
    return (int64_t)whole;
}

static inline int inside_window(double x, double y, const Window *window, int64_t *row, int64_t *column) {
    *column = floored_quotient(x + window->shift, window) - window->column;
    *row = floored_quotient(y + window->shift, window) - window->row;
    return *row >= 0 && *row < window->size && *column >= 0 && *column < window->size;
}

/* Cells of the window at so many points of a beam, a step and more from its origin on; -1 outside. Almost always by the inverse of a cell's
 * side, as in floored_quotient, for all points alike. */
WIDE static void along_beam(Py_ssize_t points, const double *origin, const double *direction, double step, const Window *window, int32_t *out) {
    const double first_column = (double)window->column, first_row = (double)window->row, size = (double)window->size;
    const double inverse = window->inverse, shift = window->shift;
    const double x = origin[0], y = origin[1], dx = direction[0], dy = direction[1];
    double far = fabs(x) > fabs(y) ? fabs(x) : fabs(y);
    int doubtful = !((far + shift + step * (double)(points + 1)) * inverse < 1e6);
    const int32_t across = (int32_t)window->size;
    for (Py_ssize_t k = 0; !doubtful && k < points; k += BLOCK) {
        int32_t some = (int32_t)(points - k < BLOCK ? points - k : BLOCK), close = 0;
        for (int32_t n = 0; n < some; n++) {
            double along = step + (double)((int32_t)k + n) * step, u = (x + along * dx + shift) * inverse, v = (y + along * dy + shift) * inverse;
            double column = (double)(int32_t)u, row = (double)(int32_t)v;
            column -= u < column ? 1.0 : 0.0;
            row -= v < row ? 1.0 : 0.0;
            double right = u - column, above = v - row;
            close |= !((right > 1e-6) & (right < 1 - 1e-6) & (above > 1e-6) & (above < 1 - 1e-6));
            column -= first_column;
            row -= first_row;
            int32_t at = (int32_t)row * across + (int32_t)column;
            out[k + n] = (row >= 0) & (row < size) & (column >= 0) & (column < size) ? at : -1;
        }
        doubtful = close;
    }
    int64_t row, column;
    for (Py_ssize_t k = 0; doubtful && k < points; k++) {
        double along = step + (double)k * step;
        out[k] = inside_window(x + along * dx, y + along * dy, window, &row, &column) ? (int32_t)(row * window->size + column) : -1;
    }
}

KERNEL(elfes) {
    TAKE("d2d1d3d1xxxxxf2!");
    Py_ssize_t size = LENGTH(0, 0), rays = LENGTH(3, 0), side = LENGTH(4, 0), cells = side * side;
    if (!sized(&given, LENGTH(0, 1) == 2 && LENGTH(1, 0) == size && LENGTH(2, 0) == size && LENGTH(2, 1) == rays && LENGTH(2, 2) == 2 &&
                           LENGTH(4, 1) == side))
        return NULL;
    const double *distances = ARRAY(1)->buf, *weights = ARRAY(3)->buf;
    double half = given.number[0], cell = given.number[1], free_ = given.number[2], occupied = given.number[3], step = cell / 2;
    const Window window = {0, 0, side, cell, 1 / cell, half};
    double longest = 0;
    for (Py_ssize_t n = 0; n < size; n++) longest = distances[n] > longest ? distances[n] : longest;
    double *total = calloc(2 * cells, sizeof *total), *one = total + cells; /* of all detections, and of the one at hand */
    int32_t *mine = calloc(2 * cells, sizeof *mine), *list = mine + cells; /* the detection that touched a cell last; what this one touched */
    int32_t *way = isfinite(longest) ? malloc((size_t)(longest / step + 3) * sizeof *way) : NULL;
    if (total == NULL || mine == NULL || way == NULL) {
        free(total);
        free(mine);
        free(way);
        drop(&given);
        return PyErr_NoMemory();
    }
    Py_BEGIN_ALLOW_THREADS;
    for (Py_ssize_t n = 0; n < size; n++) {
        const double *origin = ROW(double, 0, n);
        double distance = distances[n];
        Py_ssize_t touched = 0, steps = (Py_ssize_t)ceil((distance - given.number[4] - step) / step);
        for (Py_ssize_t r = 0; r < 2 * rays; r++) { /* what the rays pass, then where they end */
            const double *ray = ROW3(double, 2, n, r % rays);
            int ends = r >= rays;
            double said = ends ? occupied * weights[r - rays] : free_ * weights[r];
            if (ends) way[0] = (int32_t)patch_cell(origin[0] + distance * ray[0], origin[1] + distance * ray[1], half, cell, side);
            else along_beam(steps, origin, ray, step, &window, way);
            int32_t before = -1;
            for (Py_ssize_t k = 0; k < (ends ? 1 : steps); k++) {
                int32_t at = way[k];
                if (at < 0 || at == before) continue;
                before = at;
                if (mine[at] != n + 1) {
                    mine[at] = (int32_t)(n + 1);
                    list[touched++] = at;
                }
                one[at] += said;
            }
        }
        for (Py_ssize_t t = 0; t < touched; t++) {
            total[list[t]] += (double)(float)one[list[t]];
            one[list[t]] = 0;
        }
    }
    for (Py_ssize_t i = 0; i < side; i++)
        for (Py_ssize_t j = 0; j < side; j++) ROW(float, 4, i)[j] = (float)total[i * side + j];
    Py_END_ALLOW_THREADS;
    free(total);
    free(mine);
    free(way);
    return done(&given);
}

/* What a look adds to one cell of the window: where it is, in the window and in its tile. */
typedef struct {
    int32_t at;
    uint32_t tile;
    uint16_t inside, who, crossed;
    double share, near;
} Touched;

enum { OWN_MARK = 1, PASSED_MARK = 2, HIT_MARK = 4 }; /* bits of a cell's marks */

typedef struct {
    Touched *list; /* the caller's: few of the cells that may be touched are, and pages of the kernel's would be new each time */
    Py_ssize_t count;
    uint32_t *numbers; /* of cells, their place in the list from 1; 0: none */
    int64_t *begins; /* of each tile the cells so far, at the next one's place */
    uint32_t row, column, size, wide; /* of the window's first cell in the first tile, cells along a side, tiles along a row */
    uint64_t inverse; /* of the size, times 2^45: a product's whole part is the quotient, of what is below 2^30 by what is below 2^15 */
} Look;

static inline Touched *touch(Look *look, int32_t at) {
    uint32_t place = look->numbers[at];
    if (!place) {
        uint32_t i = (uint32_t)((uint64_t)at * look->inverse >> 45), row = i + look->row, column = (uint32_t)at - i * look->size + look->column;
        uint32_t tile = (row >> 7) * look->wide + (column >> 7);
        look->begins[tile + 1]++;
        look->list[look->count++] = (Touched){.at = at, .tile = tile, .inside = (uint16_t)((row & 127) * SIDE + (column & 127))};
        look->numbers[at] = place = (uint32_t)look->count;
    }
    return &look->list[place - 1];
}

static int ascending(const void *one, const void *other) { return (*(int32_t *)one > *(int32_t *)other) - (*(int32_t *)one < *(int32_t *)other); }

KERNEL(look) {
    TAKE("xxxxd2d2d1d2d2d1H1xl1d1f1!B1!I1!B2!l1!i1!f1!f1!f1!H1!");
    int64_t row = (int64_t)given.number[0], column = (int64_t)given.number[1], size = (int64_t)given.number[2];
    Py_ssize_t beams = LENGTH(3, 0), rays = LENGTH(2, 0), around = LENGTH(7, 0), cells = size * size, tile_row = row >> 7, tile_column = column >> 7;
    Py_ssize_t tall = ((row + size - 1) >> 7) - tile_row + 1, wide = ((column + size - 1) >> 7) - tile_column + 1;
    int fits = LENGTH(0, 0) == beams && LENGTH(0, 1) == rays && LENGTH(1, 0) == beams && LENGTH(1, 1) == rays && LENGTH(3, 1) == 2 &&
               LENGTH(4, 0) == beams && LENGTH(4, 1) == 2 && LENGTH(5, 0) == beams && LENGTH(6, 0) == beams && LENGTH(8, 0) == around &&
               given.array[12].strides[0] == sizeof(Touched) && LENGTH(12, 1) == sizeof(Touched) && LENGTH(13, 0) == tall * wide + 1 && size > 0 && size < 1 << 15;
    for (int n = 9; n < 19; n++) fits &= n == 13 || LENGTH(n, 0) == cells;
    if (!sized(&given, fits)) return NULL;
    const double *shares = ARRAY(2)->buf, *distance = ARRAY(5)->buf, *weights = ARRAY(8)->buf;
    const uint16_t *radars = ARRAY(6)->buf;
    const int64_t *offsets = ARRAY(7)->buf;
    float *hit = ARRAY(9)->buf, *hits = ARRAY(15)->buf, *near = ARRAY(16)->buf, *passes = ARRAY(17)->buf;
    uint8_t *marks = ARRAY(10)->buf;
    uint32_t *numbers = ARRAY(11)->buf;
    uint16_t *who = ARRAY(18)->buf;
    int64_t *begins = ARRAY(13)->buf;
    int32_t *inside = ARRAY(14)->buf;
    double cell = given.number[3], margin = given.number[4], step = cell / 2;
    Py_ssize_t fresh = 0;
    double longest = 0;
    for (Py_ssize_t n = 0; n < beams; n++) longest = distance[n] > longest ? distance[n] : longest;
    int32_t *mine = malloc((beams + 1) * sizeof *mine), *way = isfinite(longest) ? malloc((size_t)(longest / step + 3) * sizeof *way) : NULL;
    Look look = {ARRAY(12)->buf, 0, numbers, begins, (uint32_t)(row & 127), (uint32_t)(column & 127), (uint32_t)size, (uint32_t)wide, ((uint64_t)1 << 45) / (uint64_t)size + 1};
    if (mine == NULL || way == NULL) {
        free(mine);
        free(way);
        drop(&given);
        return PyErr_NoMemory();
    }
    const Window window = {row, column, size, cell, 1 / cell, 0};
    int64_t r, c;
    Py_BEGIN_ALLOW_THREADS;
    memset(begins, 0, (tall * wide + 1) * sizeof *begins);
    for (Py_ssize_t n = 0; n < beams; n++) {
        const double *cos = ROW(double, 0, n), *sin = ROW(double, 1, n), *origin = ROW(double, 4, n);
        for (Py_ssize_t k = 0; k < rays; k++) {
            if (!inside_window(cos[k] * distance[n] + origin[0], sin[k] * distance[n] + origin[1], &window, &r, &c)) continue;
            Touched *found = touch(&look, (int32_t)(r * size + c));
            found->share += shares[k];
            found->who |= radars[n];
        }
    }
    for (Py_ssize_t n = 0; n < beams; n++) {
        const double *point = ROW(double, 3, n), *origin = ROW(double, 4, n);
        double far = distance[n] > 1e-9 ? distance[n] : 1e-9, direction[2] = {(point[0] - origin[0]) / far, (point[1] - origin[1]) / far};
        int32_t before = -1;
        if (inside_window(point[0], point[1], &window, &r, &c) && !(marks[r * size + c] & OWN_MARK)) {
            marks[r * size + c] |= OWN_MARK;
            mine[fresh++] = (int32_t)(r * size + c);
        }
        double limit = distance[n] - margin;
        Py_ssize_t points = limit > step ? (Py_ssize_t)((limit - step) / step) : 0; /* about as many: */
        while (points > 0 && !(step + (double)(points - 1) * step < limit)) points--;
        while (step + (double)points * step < limit) points++;
        along_beam(points, origin, direction, step, &window, way);
        Py_ssize_t passed = 0; /* different cells: how many points lie in one, no branch can foresee */
        for (Py_ssize_t k = 0; k < points; k++) {
            int32_t at = way[k];
            way[passed] = at;
            passed += (at >= 0) & (at != before);
            before = at;
        }
        for (Py_ssize_t k = 0; k < passed; k++) __builtin_prefetch(&numbers[way[k]], 1);
        for (Py_ssize_t k = 0; k < passed; k++) {
            Touched *found = touch(&look, way[k]);
            found->who |= radars[n];
            found->crossed = 1;
        }
    }
    qsort(mine, fresh, sizeof *mine, ascending); /* sums are made in this order everywhere */
    for (Py_ssize_t n = 0; n < fresh; n++)
        for (Py_ssize_t k = 0; k < around; k++) {
            int64_t at = mine[n] + offsets[k];
            if (at < 0 || at >= cells) continue;
            Touched *found = touch(&look, (int32_t)at);
            found->near += weights[k];
        }
    for (Py_ssize_t t = 0; t < tall * wide; t++) begins[t + 1] += begins[t];
    for (Py_ssize_t n = 0; n < look.count; n++) {
        const Touched *found = &look.list[n];
        if (n + AHEAD < look.count) __builtin_prefetch(&marks[look.list[n + AHEAD].at], 1);
        Py_ssize_t out = begins[found->tile]++;
        uint8_t *mark = &marks[found->at];
        numbers[found->at] = 0;
        hits[out] = 0;
        if (found->share > 0) {
            float share = (float)(found->share < 1 ? found->share : 1), before = *mark & HIT_MARK ? hit[found->at] : 0;
            float more = share - before;
            hits[out] = more > 0 ? more : 0;
            hit[found->at] = before + hits[out];
            *mark |= HIT_MARK;
        }
        inside[out] = found->inside;
        near[out] = (float)found->near;
        passes[out] = found->crossed && !(*mark & PASSED_MARK);
        *mark |= found->crossed * PASSED_MARK;
        who[out] = found->who;
    }
    memmove(begins + 1, begins, tall * wide * sizeof *begins);
    begins[0] = 0;
    Py_END_ALLOW_THREADS;
    free(mine);
    free(way);
    return done(&given);
}

KERNEL(usual) {
    TAKE("l1l1l1xxxxxxxf2!f2!B1!B1!");
    Py_ssize_t size = LENGTH(3, 1), hits = LENGTH(0, 0);
    if (!sized(&given, LENGTH(3, 0) == 2 && LENGTH(4, 0) == 2 && LENGTH(4, 1) == size && LENGTH(5, 0) == size && LENGTH(6, 0) == size)) return NULL;
    uint8_t *near = calloc(2 * size, 1), *arrived = ARRAY(5)->buf, *left = ARRAY(6)->buf;
    if (near == NULL) {
        drop(&given);
        return PyErr_NoMemory();
    }
    float quick = (float)given.number[0], slow = (float)given.number[1];
    float arrives = (float)given.number[2], before = (float)given.number[3], stayed = (float)given.number[4], leaves = (float)given.number[5];
    const int64_t *hit = ARRAY(0)->buf;
    Py_BEGIN_ALLOW_THREADS;
    for (int disc = 0; disc < 2; disc++) {
        const int64_t *offsets = ARRAY(1 + disc)->buf;
        for (Py_ssize_t n = 0; n < hits; n++)
            for (Py_ssize_t k = 0; k < LENGTH(1 + disc, 0); k++) {
                int64_t at = hit[n] + offsets[k];
                if (at >= 0 && at < size) near[disc * size + at] = 1;
            }
        float *recent = ROW(float, 3, disc), *long_ago = ROW(float, 4, disc);
        const uint8_t *now = near + disc * size;
        for (Py_ssize_t c = 0; c < size; c++) {
            recent[c] += ((float)now[c] - recent[c]) * quick;
            long_ago[c] += ((float)now[c] - long_ago[c]) * slow;
        }
    }
    float *here = ROW(float, 3, 0), *beside = ROW(float, 3, 1), *known_here = ROW(float, 4, 0), *known_beside = ROW(float, 4, 1);
    if (given.number[6] == 0) {
        memset(left, 0, size);
        memset(arrived, 0, size);
    } else for (Py_ssize_t c = 0; c < size; c++) {
        left[c] = (known_here[c] > stayed) & (beside[c] < leaves);
        known_here[c] = left[c] ? 0 : known_here[c];
        known_beside[c] = left[c] ? 0 : known_beside[c];
        arrived[c] = near[c] & (here[c] > arrives) & (known_beside[c] < before * here[c]);
    }
    Py_END_ALLOW_THREADS;
    free(near);
    return done(&given);
}

/* A signal's bits. `place`: byte of the lowest one, +1 upwards or -1 downwards, shift, length, is signed; bytes beyond the payload are 0. */
static inline uint64_t bits_at(const uint8_t *payload, int64_t length, const int64_t *place) {
    int64_t first = place[0], shift = place[2], bits = place[3];
    uint64_t word = 0;
    if (shift + bits <= 64 && (place[1] > 0 ? first >= 0 && first + 8 <= length : first >= 7 && first < length)) {
        memcpy(&word, payload + (place[1] > 0 ? first : first - 7), sizeof word);
        word = (place[1] > 0) == LITTLE ? word : __builtin_bswap64(word);
        word >>= shift;
    } else
        for (int64_t k = 0; 8 * k < shift + bits; k++) {
            int64_t at = first + k * place[1];
            uint64_t byte = at >= 0 && at < length ? payload[at] : 0;
            word |= 8 * k >= shift ? byte << (8 * k - shift) : byte >> (shift - 8 * k);
        }
    return bits < 64 ? word & (((uint64_t)1 << bits) - 1) : word;
}

static inline int64_t integer_of(uint64_t bits, const int64_t *place) {
    uint64_t sign = place[4] ? (uint64_t)1 << (place[3] - 1) : 0;
    return (int64_t)((bits ^ sign) - sign);
}

static inline int64_t integer_at(const uint8_t *payload, int64_t length, const int64_t *place) {
    return integer_of(bits_at(payload, length, place), place);
}

KERNEL(signals) {
    TAKE("B2l2d2Q2!l2!d2!B2!");
    Py_ssize_t size = LENGTH(0, 0), length = LENGTH(0, 1), columns = LENGTH(1, 0);
    int fits = LENGTH(1, 1) == 5 && LENGTH(2, 0) == columns && LENGTH(2, 1) == 2;
    for (int n = 3; n < 7; n++) fits &= LENGTH(n, 0) == size && LENGTH(n, 1) == columns;
    if (!sized(&given, fits)) return NULL;
    for (Py_ssize_t n = 0; n < size; n++) {
        const uint8_t *payload = ROW(uint8_t, 0, n);
        for (Py_ssize_t c = 0; c < columns; c++) {
            const int64_t *place = ROW(int64_t, 1, c);
            const double *linear = ROW(double, 2, c);
            uint64_t word = bits_at(payload, length, place);
            ROW(uint64_t, 3, n)[c] = word;
            int64_t raw = integer_of(word, place);
            ROW(int64_t, 4, n)[c] = raw;
            ROW(double, 5, n)[c] = (double)raw * linear[0] + linear[1];
            ROW(uint8_t, 6, n)[c] = 1;
        }
    }
    return done(&given);
}

/* The value of a flag for one frame and one of its numbered signals. */
static inline int holds(const int64_t *flag, const int64_t *numbers, const int64_t *raw, const uint8_t *there, Py_ssize_t each, Py_ssize_t k) {
    int64_t value = raw[flag[0] * each + k];
    int found = 0;
    for (int64_t i = flag[2]; i < flag[3]; i++) found |= value == numbers[i];
    return (found == (int)flag[1]) & there[flag[0] * each + k];
}

KERNEL(quantities) {
    TAKE("d2l2B2xl2d2l2l1xxd2!");
    Py_ssize_t size = LENGTH(0, 0), columns = LENGTH(0, 1), each = (Py_ssize_t)given.number[0], kinds = LENGTH(3, 0), flags = LENGTH(5, 0);
    int64_t all = (int64_t)given.number[1];
    double greatest = given.number[2];
    int fits = LENGTH(1, 0) == size && LENGTH(1, 1) == columns && LENGTH(2, 0) == size && LENGTH(2, 1) == columns && LENGTH(3, 1) == 3 &&
               LENGTH(4, 0) == kinds && LENGTH(4, 1) == 2 && LENGTH(5, 1) == 4 && LENGTH(7, 0) == kinds && LENGTH(7, 1) == size * each && all < flags;
    for (Py_ssize_t f = 0; fits && f < flags; f++) {
        const int64_t *flag = ROW(int64_t, 5, f);
        fits = flag[0] >= 0 && (flag[0] + 1) * each <= columns && flag[2] >= 0 && flag[3] <= LENGTH(6, 0);
    }
    for (Py_ssize_t q = 0; fits && q < kinds; q++) {
        const int64_t *plan = ROW(int64_t, 3, q);
        fits = plan[0] >= 0 && (plan[0] + 1) * each <= columns && plan[1] < flags && plan[2] < flags;
    }
    if (!sized(&given, fits)) return NULL;
    const int64_t *numbers = ARRAY(6)->buf;
    for (Py_ssize_t n = 0; n < size; n++) {
        const double *physical = ROW(double, 0, n);
        const int64_t *raw = ROW(int64_t, 1, n);
        const uint8_t *there = ROW(uint8_t, 2, n);
        for (Py_ssize_t k = 0; k < each; k++) {
            int sound = all < 0 || holds(ROW(int64_t, 5, all), numbers, raw, there, each, k);
            for (Py_ssize_t q = 0; q < kinds; q++) {
                const int64_t *plan = ROW(int64_t, 3, q); /* row of its signal, flag of its validity, flag of its sign; -1: none */
                const double *unit = ROW(double, 4, q);
                double value = physical[plan[0] * each + k] * unit[0] + unit[1];
                if (plan[2] >= 0 && holds(ROW(int64_t, 5, plan[2]), numbers, raw, there, each, k)) value = -value;
                if (!sound || (plan[1] >= 0 && !holds(ROW(int64_t, 5, plan[1]), numbers, raw, there, each, k))) value = NAN;
                ROW(double, 7, q)[n * each + k] = fabs(value) < greatest ? value : NAN;
            }
        }
    }
    return done(&given);
}

WIDE static void unzip(const uint8_t *restrict from, Py_ssize_t width, uint8_t *restrict even, uint8_t *restrict odd) {
    for (Py_ssize_t j = 0; j < width; j++) {
        even[j] = from[2 * j];
        odd[j] = from[2 * j + 1];
    }
}

KERNEL(fold) {
    TAKE("B3B3!");
    Py_ssize_t planes = LENGTH(0, 0), height = LENGTH(1, 1), width = LENGTH(1, 2);
    if (!sized(&given, LENGTH(0, 1) == 2 * height && LENGTH(0, 2) == 2 * width && LENGTH(1, 0) == 4 * planes)) return NULL;
    for (Py_ssize_t p = 0; p < planes; p++)
        for (Py_ssize_t i = 0; i < 2 * height; i++) {
            Py_ssize_t part = 4 * p + 2 * (i & 1);
            unzip(ROW3(uint8_t, 0, p, i), width, ROW3(uint8_t, 1, part, i >> 1), ROW3(uint8_t, 1, part + 1, i >> 1));
        }
    return done(&given);
}

/* x within the two; the lower one for what is no number. */
static inline float within(float x, float least, float most) {
    float above = x > least ? x : least;
    return above < most ? above : most;
}

/* exp(x) for |x| <= 87: 2^k exp(r), r within half of ln 2, by the reference's sums and products. */
static inline float exponential(float x) {
    int32_t k = (int32_t)(x * 1.44269502f + copysignf(0.5f, x)), bits = (k + 127) * (1 << 23);
    float r = x - (float)k * 0.693359375f + (float)k * 2.12194440e-4f, p = 1.98412698e-4f, power;
    p = p * r + 1.38888889e-3f;
    p = p * r + 8.33333333e-3f;
    p = p * r + 4.16666667e-2f;
    p = p * r + 1.66666667e-1f;
    p = p * r + 0.5f;
    p = p * r + 1.0f;
    p = p * r + 1.0f;
    memcpy(&power, &bits, sizeof power);
    return p * power;
}

/* Two parts of a row by turns: all cells of one step before the next one's, as a step without a branch is taken for many at once. */
WIDE static void odds_row(const float *const *vacant, const float *const *unknown, const float *const *occupied, Py_ssize_t width, float *restrict odds,
                          float *restrict share) {
    float difference[2][BLOCK], known[2][BLOCK], rest[2][BLOCK];
    for (Py_ssize_t from = 0; from < width; from += BLOCK) {
        Py_ssize_t some = width - from < BLOCK ? width - from : BLOCK;
        for (int side = 0; side < 2; side++) {
            const float *one = vacant[side] + from, *none = unknown[side] + from, *other = occupied[side] + from;
            for (Py_ssize_t n = 0; n < some; n++) {
                float apart = other[n] - one[n], size = -fabsf(apart);
                difference[side][n] = apart;
                known[side][n] = size < -60 ? -60 : size;
                rest[side][n] = within(none[n] - (apart > 0 ? other[n] : one[n]), -60, 60);
            }
            for (Py_ssize_t n = 0; n < some; n++) known[side][n] = 1 + exponential(known[side][n]);
            for (Py_ssize_t n = 0; n < some; n++) rest[side][n] = known[side][n] / (known[side][n] + exponential(rest[side][n]));
        }
        for (Py_ssize_t n = 0; n < some; n++) {
            odds[2 * (from + n)] = difference[0][n];
            odds[2 * (from + n) + 1] = difference[1][n];
        }
        for (Py_ssize_t n = 0; n < some; n++) {
            share[2 * (from + n)] = rest[0][n];
            share[2 * (from + n) + 1] = rest[1][n];
        }
    }
}

KERNEL(odds) {
    TAKE("f3f3!");
    Py_ssize_t height = LENGTH(0, 1), width = LENGTH(0, 2);
    if (!sized(&given, LENGTH(0, 0) == 12 && LENGTH(1, 0) == 2 && LENGTH(1, 1) == 2 * height && LENGTH(1, 2) == 2 * width)) return NULL;
    for (Py_ssize_t i = 0; i < 2 * height; i++) {
        const float *planes[3][2];
        for (int k = 0; k < 6; k++) planes[k / 2][k % 2] = ROW3(float, 0, 4 * (k / 2) + 2 * (i & 1) + k % 2, i >> 1);
        odds_row(planes[0], planes[1], planes[2], width, ROW3(float, 1, 0, i), ROW3(float, 1, 1, i));
    }
    return done(&given);
}

/* ln x for x within 1e-30 … 1e30: 2^k m, m within a factor of the root of 2 of 1, by the reference's sums and products. */
static inline float logarithm(float x) {
    const int32_t half_root = 0x3f3504f3;
    int32_t bits;
    x = within(x, 1e-30f, 1e30f);
    memcpy(&bits, &x, sizeof bits);
    bits -= half_root;
    int32_t low = (bits & 0x7fffff) + half_root;
    float k = (float)(bits >> 23), m;
    memcpy(&m, &low, sizeof m);
    float ratio = (m - 1) / (m + 1), square = ratio * ratio, series = (float)(1.0 / 11);
    series = series * square + (float)(1.0 / 9);
    series = series * square + (float)(1.0 / 7);
    series = series * square + (float)(1.0 / 5);
    series = series * square + (float)(1.0 / 3);
    return (2 * ratio * square * series - k * 2.12194440e-4f) + 2 * ratio + k * 0.693359375f;
}

/* The numbers of the rule, as the arguments have them. */
typedef struct {
    float gain, offset, learned, prior, surest, hit, near, passed, none, doubt, doubted, slope, steep, alone, enough, surer, least, calmer;
} Rule;

/* A cell's values stand in arrays from one step to the next: a step that is taken for all cells has no branch. */
WIDE static void read_block(const float *const *layers, Py_ssize_t width, const Rule *given, float *out) {
    const float *total = layers[0], *weight = layers[1], *hits = layers[2], *beside = layers[3], *passes = layers[4];
    const Rule rule = *given;
    float mean[BLOCK], said[BLOCK], passing[BLOCK], weighed[BLOCK], aside[BLOCK], bent[BLOCK], lone[BLOCK], odds[BLOCK], level[BLOCK];
    for (Py_ssize_t j = 0; j < width; j++) {
        float divisor = weight[j] > 1e-6f ? weight[j] : 1e-6f;
        mean[j] = rule.gain * (total[j] / divisor) + rule.offset;
    }
    for (Py_ssize_t j = 0; j < width; j++) said[j] = weight[j] > 0 ? mean[j] : 0;
    for (Py_ssize_t j = 0; j < width; j++) {
        passing[j] = rule.passed * (passes[j] * sqrtf(sqrtf(passes[j]))) + rule.none;
        weighed[j] = exponential(within(rule.learned * said[j], -rule.prior, rule.surest)) / passing[j];
        aside[j] = weighed[j] * (rule.near * beside[j] + rule.none);
    }
    for (Py_ssize_t j = 0; j < width; j++) {
        lone[j] = exponential(within(rule.steep * said[j] + rule.alone, -60, rule.enough)) / passing[j];
    }
    for (Py_ssize_t j = 0; j < width; j++) bent[j] = exponential(rule.doubt + rule.slope * (logarithm(aside[j]) - rule.doubt));
    for (Py_ssize_t j = 0; j < width; j++) {
        aside[j] = aside[j] > rule.doubted ? bent[j] : aside[j];
        lone[j] = said[j] == 0 ? 0 : lone[j];
    }
    for (Py_ssize_t j = 0; j < width; j++) {
        float inside = weighed[j] * (rule.hit * hits[j] + rule.none);
        odds[j] = logarithm(aside[j] * aside[j] + inside * inside + lone[j] * lone[j]) * 0.5f;
        float above = odds[j] - rule.doubt, share = above / rule.doubt, surely = rule.doubt + rule.surer * above;
        float between = rule.least + rule.least * (share * share * share), calmly = rule.calmer * odds[j];
        float beyond = odds[j] < 0 ? between : calmly;
        level[j] = above < 0 ? surely : beyond;
    }
    for (Py_ssize_t j = 0; j < width; j++) {
        int known = (total[j] != 0) | (weight[j] != 0) | (hits[j] != 0) | (beside[j] != 0) | (passes[j] != 0);
        float found = level[j] == 0 ? 1.17549435e-38f : level[j];
        out[j] = known ? found : 0;
    }
}

/* Whether any of so many numbers is not 0. */
WIDE static int any(const float *values, Py_ssize_t count) {
    uint32_t found = 0, bits;
    for (Py_ssize_t j = 0; j < count; j++) {
        memcpy(&bits, values + j, sizeof bits);
        found |= bits << 1;
    }
    return found != 0;
}

/* Where a part of so many cells, from `first` on along one axis of the window, begins and ends to lie in the window. */
static inline void clipped(int64_t first, int64_t cells, int64_t window, int64_t *begin, int64_t *end) {
    *begin = first < 0 ? -first : 0;
    *end = cells < window - first ? cells : window - first;
}

KERNEL(read_out) {
    TAKE("xxl2*f3xxf1f2!");
    const List *parts = &given.list[0];
    int64_t height = LENGTH(2, 0), width = LENGTH(2, 1), top, bottom, left, right;
    int fits = LENGTH(0, 0) == parts->count && LENGTH(0, 1) == 2 && LENGTH(1, 0) == 16;
    for (Py_ssize_t t = 0; fits && t < parts->count; t++) fits = parts->array[t].shape[0] == 5;
    if (!sized(&given, fits)) return NULL;
    float numbers[18] = {(float)given.number[2], (float)given.number[3]};
    memcpy(numbers + 2, ARRAY(1)->buf, 16 * sizeof *numbers);
    Rule rule;
    memcpy(&rule, numbers, sizeof rule);
    Py_BEGIN_ALLOW_THREADS;
    for (int64_t i = 0; i < height; i++) memset(ROW(float, 2, i), 0, width * sizeof(float));
    for (Py_ssize_t t = 0; t < parts->count; t++) {
        const Py_buffer *part = &parts->array[t];
        const int64_t *place = ROW(int64_t, 0, t), down = place[0] - (int64_t)given.number[0], across = place[1] - (int64_t)given.number[1];
        clipped(down, part->shape[1], height, &top, &bottom);
        clipped(across, part->shape[2], width, &left, &right);
        for (int64_t i = top; i < bottom; i++)
            for (int64_t j = left; j < right; j += BLOCK) {
                Py_ssize_t some = right - j < BLOCK ? right - j : BLOCK;
                const float *from[5];
                int known = 0;
                for (int p = 0; p < 5; p++) {
                    from[p] = (const float *)((const char *)part->buf + p * part->strides[0] + i * part->strides[1]) + j;
                    known |= any(from[p], some);
                }
                if (known) read_block(from, some, &rule, ROW(float, 2, down + i) + across + j);
            }
    }
    Py_END_ALLOW_THREADS;
    return done(&given);
}

WIDE static void percent_block(const float *log_odds, Py_ssize_t width, int8_t *out) {
    int32_t surely[BLOCK];
    float size[BLOCK];
    for (Py_ssize_t j = 0; j < width; j++) size[j] = fabsf(log_odds[j]) < 60 ? fabsf(log_odds[j]) : 60;
    for (Py_ssize_t j = 0; j < width; j++) surely[j] = (int32_t)(100 / (1 + exponential(-size[j])) + 0.5f);
    for (Py_ssize_t j = 0; j < width; j++) {
        surely[j] = log_odds[j] < 0 ? 100 - surely[j] : surely[j];
        surely[j] = log_odds[j] == 0 ? -1 : surely[j];
    }
    for (Py_ssize_t j = 0; j < width; j++) out[j] = (int8_t)surely[j];
}

KERNEL(percent) {
    TAKE("f2b2!");
    Py_ssize_t height = LENGTH(0, 0), width = LENGTH(0, 1);
    if (!sized(&given, LENGTH(1, 0) == height && LENGTH(1, 1) == width)) return NULL;
    Py_BEGIN_ALLOW_THREADS;
    for (Py_ssize_t i = 0; i < height; i++)
        for (Py_ssize_t j = 0; j < width; j += BLOCK) {
            Py_ssize_t some = width - j < BLOCK ? width - j : BLOCK;
            percent_block(ROW(float, 0, i) + j, some, ROW(int8_t, 1, i) + j);
        }
    Py_END_ALLOW_THREADS;
    return done(&given);
}

KERNEL(differing) {
    TAKE("b2b2l1!");
    Py_ssize_t height = LENGTH(0, 0), width = LENGTH(0, 1), top = -1, bottom = -1, left = width, right = -1;
    if (!sized(&given, LENGTH(1, 0) == height && LENGTH(1, 1) == width && LENGTH(2, 0) == 4)) return NULL;
    int64_t *out = ARRAY(2)->buf;
    for (Py_ssize_t i = 0; i < height; i++) {
        const int8_t *one = ROW(int8_t, 0, i), *other = ROW(int8_t, 1, i);
        if (!memcmp(one, other, width)) continue;
        top = top < 0 ? i : top;
        bottom = i;
        for (Py_ssize_t j = 0; j < left; j++)
            if (one[j] != other[j]) left = j;
        for (Py_ssize_t j = width - 1; j > right; j--)
            if (one[j] != other[j]) right = j;
    }
    out[0] = top < 0 ? 0 : top;
    out[1] = top < 0 ? 0 : left;
    out[2] = top < 0 ? 0 : bottom - top + 1;
    out[3] = top < 0 ? 0 : right - left + 1;
    return done(&given);
}

#include "sweeps.h"
#include "tiles.h"
#include "lines.h"
#include "intake.h"
#include "scans.h"

#define ENTRY(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, "As reference." #name "."}
static PyMethodDef methods[] = {
    ENTRY(moved),     ENTRY(placed), ENTRY(sensors), ENTRY(deviations), ENTRY(draw_now),  ENTRY(draw_past), ENTRY(draw_passes), ENTRY(draw_looks),   ENTRY(bilinear), ENTRY(add_clamped),
    ENTRY(note_views), ENTRY(add_looks), ENTRY(elfes),    ENTRY(look),        ENTRY(add_measured), ENTRY(usual),
    ENTRY(signals),   ENTRY(quantities), ENTRY(fold), ENTRY(odds), ENTRY(standing), ENTRY(common_motion),
    ENTRY(read_out),  ENTRY(percent), ENTRY(differing),
    ENTRY(gathered), ENTRY(recalled), ENTRY(gated), ENTRY(possible), ENTRY(nearby), ENTRY(leanings),
    ENTRY(candump_lines), ENTRY(asc_lines), ENTRY(trc_lines), ENTRY(csv_lines), ENTRY(blf_objects), ENTRY(assemble), ENTRY(identify), ENTRY(can_frames), ENTRY(join_frames),
    {NULL, NULL, 0, NULL},
};
/* Which sources it is of, so that dispatch.py can tell an older build. */
static int say_built_from(PyObject *self) { return PyModule_AddObject(self, "_built_from", PyLong_FromUnsignedLong(BUILT_FROM)); }
static PyModuleDef_Slot slots[] = {{Py_mod_exec, say_built_from}, {0, NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "compiled", "The hot loops, compiled.", 0, methods, slots, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit_compiled(void) {
    fill_tables();
    return PyModuleDef_Init(&module);
}
