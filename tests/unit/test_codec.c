// The codec writes the same bytes as lcm-gen's encoders, and drops every malformed message.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "lockstep/codec.h"
#include "tests/support/unit.h"

#define COUNT 3   // elements of every array
#define ARRAYS 24 // of a message, at most
#define CAPACITY 4096

// --- one message of each type, and uniform access to it ---

static double values[5][COUNT] = {
    {1.5, -0.0, 5e-324}, {1e308, -2, 3}, {4, 5, 6}, {7, 8, -9}, {-1e-9, 0, 11}};
static int64_t counts[3][COUNT] = {{100, INT64_MAX, 0}, {INT64_MIN, -1, 10}, {7, 0, 1}};

static portmet_flux_t flux = {
    .session = INT64_MAX,
    .step = 7,
    .round = 3,
    .time = 0.1,
    .nend = COUNT,
    .ny = COUNT,
    .nresponse = COUNT,
    .nknown = COUNT,
};
static portmet_tick_t tick = {
    .session = 11,
    .instance = 6,
    .digest = INT64_MIN,
    .granted = 4,
    .steps = 200,
    .dt = 0.3,
    .substeps = 16,
    .want_state = 1,
    .served = 3,
    .run = 2,
    .held = 1,
    .nstart = COUNT,
    .nanswer = COUNT,
    .nlive = COUNT,
};
static portmet_report_t report = {
    .session = 11,
    .instance = INT64_MAX,
    .coordinator = 6,
    .digest = -5,
    .kind = PORTMET_REPORT_T_FAILED,
    .code = 9,
    .step = 12,
    .time = 3.6,
    .npart = COUNT,
    .nend = COUNT - 1,
    .nz = COUNT - 2,
    .message = "link2: z[3] is nan",
};
static const portmet_ledger_t ledger = {
    .session = 11,
    .step = 1,
    .time = 0.3,
    .energy = 1e3,
    .entropy = 2,
    .energy_residual = 1e-16,
    .entropy_residual = -0.,
    .violations = 2,
};
static const portmet_command_t command = {.session = 11,
                                          .instance = 3,
                                          .addressee = 7,
                                          .answer = INT64_MIN,
                                          .kind = PORTMET_COMMAND_T_ABORT,
                                          .code = 7,
                                          .reason = "gr\xc3\xbc\xc3\x9f dich"};
static const portmet_hello_t hello = {.protocol = -5,
                                      .session = 0,
                                      .instance = 7,
                                      .nonce = INT64_MAX,
                                      .coordinator = 6,
                                      .digest = -9,
                                      .checkpoint = 100,
                                      .sender = "a"};
static const portmet_request_t request = {.session = 11,
                                          .sender = "",
                                          .instance = 4,
                                          .attempt = 2,
                                          .channel = "scene_FLUX_a",
                                          .step = 3,
                                          .round = 1};

// Memory for decoding, kept at exact sizes so that a sanitizer sees any byte too many.
static void *decoded[ARRAYS];

// Sets the array pointers of a message: to the numbers above, or, with `largest`, to memory for
// decoding, and the counts to the length of that memory.
static void set_arrays(const pm_wire_type *type, void *message, bool largest) {
    const int32_t count = COUNT;
    char *m = message;
    int n = 0;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        const bool doubles = f->kind == PM_WIRE_DOUBLES;
        if (f->kind == PM_WIRE_COUNT && largest) {
            memcpy(m + f->offset, &count, sizeof count);
        }
        if (doubles || f->kind == PM_WIRE_I64S) {
            void *numbers = doubles ? (void *)values[n % 5] : (void *)counts[n % 3];
            void **array = largest ? &decoded[n] : &numbers;
            memcpy(m + f->offset, array, sizeof *array);
            assert_true(++n <= ARRAYS);
        }
    }
}

// Encodes with our code and with lcm-gen's; decodes with ours and, if kept, encodes again to
// `back`.
typedef struct codec_case {
    const char *name;
    size_t (*ours)(void *data, size_t capacity);
    int (*theirs)(void *data, int capacity);
    size_t (*size)(void);
    pm_drop (*decode)(const void *data, size_t size, void *back, size_t *back_size);
} codec_case;

#define CODEC_CASE(type)                                                                         \
    static size_t ours_##type(void *data, size_t capacity) {                                     \
        return pm_##type##_encode(&type, data, capacity);                                        \
    }                                                                                            \
    static int theirs_##type(void *data, int capacity) {                                         \
        return portmet_##type##_t_encode(data, 0, capacity, &type);                              \
    }                                                                                            \
    static size_t size_##type(void) {                                                            \
        return (size_t)portmet_##type##_t_encoded_size(&type);                                   \
    }                                                                                            \
    static pm_drop decode_##type(const void *data, size_t size, void *back, size_t *back_size) { \
        portmet_##type##_t message = {0};                                                        \
        set_arrays(&pm_##type##_type, &message, true);                                           \
        const pm_drop drop = pm_##type##_decode(&message, data, size);                           \
        *back_size = drop == PM_KEEP ? pm_##type##_encode(&message, back, CAPACITY) : 0;         \
        return drop;                                                                             \
    }

CODEC_CASE(flux)
CODEC_CASE(tick)
CODEC_CASE(report)
CODEC_CASE(ledger)
CODEC_CASE(command)
CODEC_CASE(request)
CODEC_CASE(hello)

#define ROW(type) \
    { #type, ours_##type, theirs_##type, size_##type, decode_##type }
static const codec_case cases[] = {ROW(flux),    ROW(tick),    ROW(report), ROW(ledger),
                                   ROW(command), ROW(request), ROW(hello)};
#define NCASE (sizeof cases / sizeof cases[0])

static int make_memory(void **context) {
    (void)context;
    for (int i = 0; i < ARRAYS; ++i) {
        decoded[i] = malloc(COUNT * sizeof(double));
        assert_non_null(decoded[i]);
    }
    set_arrays(&pm_flux_type, &flux, false);
    set_arrays(&pm_tick_type, &tick, false);
    set_arrays(&pm_report_type, &report, false);
    return 0;
}

static int free_memory(void **context) {
    (void)context;
    for (int i = 0; i < ARRAYS; ++i) {
        free(decoded[i]);
    }
    return 0;
}

// Decodes from a block of exactly `size` bytes. A message that is kept must be canonical: encoding
// what was understood gives the same bytes.
static pm_drop decode(const codec_case *c, const unsigned char *data, size_t size) {
    unsigned char *exact = malloc(size + (size == 0));
    assert_non_null(exact);
    memcpy(exact, data, size);
    unsigned char back[CAPACITY];
    size_t back_size = 0;
    const pm_drop drop = c->decode(exact, size, back, &back_size);
    if (drop == PM_KEEP) {
        assert_int_equal(back_size, size);
        assert_memory_equal(back, exact, size);
    }
    free(exact);
    return drop;
}

static void assert_drop(const codec_case *c, const unsigned char *data, size_t size,
                        pm_drop expected) {
    const pm_drop drop = decode(c, data, size);
    if (drop != expected) {
        fail_msg("%s of %zu bytes: %s, expected %s", c->name, size, pm_drop_name(drop),
                 pm_drop_name(expected));
    }
}

static void put(unsigned char *at, size_t size, uint64_t bits) {
    for (size_t i = 0; i < size; ++i) {
        at[i] = (unsigned char)(bits >> (8 * (size - 1 - i)));
    }
}

// --- tests ---

static void test_bytes_equal_generated(void **context) {
    (void)context;
    for (size_t i = 0; i < NCASE; ++i) {
        const codec_case *c = &cases[i];
        unsigned char ours[CAPACITY], theirs[CAPACITY];
        const size_t size = c->ours(ours, sizeof ours);
        assert_int_equal(size, c->theirs(theirs, sizeof theirs));
        assert_memory_equal(ours, theirs, size);
        assert_int_equal(size, c->size());
        assert_drop(c, theirs, size, PM_KEEP);
    }
    assert_int_equal(pm_flux_size(&flux), portmet_flux_t_encoded_size(&flux));
    assert_int_equal(pm_report_size(&report), portmet_report_t_encoded_size(&report));
}

static void test_capacity_is_respected(void **context) {
    (void)context;
    for (size_t i = 0; i < NCASE; ++i) {
        const size_t size = cases[i].size();
        for (size_t capacity = 0; capacity <= size; ++capacity) {
            unsigned char *data = malloc(capacity + (capacity == 0));
            assert_non_null(data);
            assert_int_equal(cases[i].ours(data, capacity), capacity == size ? size : 0);
            free(data);
        }
    }
}

static void test_every_truncation_is_dropped(void **context) {
    (void)context;
    for (size_t i = 0; i < NCASE; ++i) {
        unsigned char data[CAPACITY] = {0};
        const size_t size = cases[i].ours(data, sizeof data);
        for (size_t length = 0; length < size; ++length) {
            assert_drop(&cases[i], data, length, PM_DROP_LENGTH);
        }
        assert_drop(&cases[i], data, size + 1, PM_DROP_LENGTH);
        assert_drop(&cases[i], data, size + 1000, PM_DROP_LENGTH);
    }
}

static void test_foreign_types_are_dropped(void **context) {
    (void)context;
    for (size_t i = 0; i < NCASE; ++i) {
        unsigned char data[CAPACITY];
        const size_t size = cases[i].ours(data, sizeof data);
        for (size_t j = 0; j < NCASE; ++j) {
            assert_drop(&cases[j], data, size, i == j ? PM_KEEP : PM_DROP_TYPE);
        }
    }
}

// A count at the place `at` of a message, that is refused whatever follows it.
static void assert_count_dropped(const codec_case *c, uint32_t count, size_t at) {
    unsigned char data[CAPACITY] = {0};
    const size_t size = c->ours(data, sizeof data);
    put(data + at, 4, count);
    assert_drop(c, data, size, PM_DROP_COUNT);
    assert_drop(c, data, at + 4, PM_DROP_COUNT);
    if (at + 4 <= 92) {
        assert_drop(c, data, 92, PM_DROP_COUNT);
    }
}

// The number of arrays with the count at this offset.
static size_t arrays_of(const pm_wire_type *type, size_t count) {
    size_t n = 0;
    for (int i = 0; i < type->nfield; ++i) {
        n += type->field[i].count == count;
    }
    return n;
}

// The datagrams that crash lcm-gen's decoders: a huge or negative count in a short message.
static void test_hostile_counts_are_dropped(void **context) {
    (void)context;
    static const uint32_t hostile[] = {0x10000000, 0x20000001, 0x7fffffff,
                                       0xffffffff, 0x80000000, COUNT + 1};
    const size_t flux_ends = 8 + 8 + 8 + 4 + 8, flux_y = flux_ends + 4 + 2 * 8 * COUNT;
    const size_t report_parts = 8 + 8 + 8 + 8 + 8 + 1 + 1 + 8 + 8;
    const size_t tick_answers = 8 + 6 * 8 + 8 + 4 + 1 + 2 * 8 + 1;
    const size_t tick_live = tick_answers + 4 + 8 * COUNT;
    const size_t of_part = arrays_of(&pm_report_type, offsetof(portmet_report_t, npart));
    const size_t of_end = arrays_of(&pm_report_type, offsetof(portmet_report_t, nend));
    const size_t report_ends = report_parts + 4 + of_part * 8 * COUNT;
    const size_t report_z = report_ends + 4 + of_end * 8 * (COUNT - 1);
    for (size_t j = 0; j < sizeof hostile / sizeof hostile[0]; ++j) {
        assert_count_dropped(&cases[0], hostile[j], flux_ends);
        assert_count_dropped(&cases[0], hostile[j], flux_y);
        assert_count_dropped(&cases[1], hostile[j], tick_answers);
        assert_count_dropped(&cases[1], hostile[j], tick_live);
        assert_count_dropped(&cases[2], hostile[j], report_parts);
        assert_count_dropped(&cases[2], hostile[j], report_ends);
        assert_count_dropped(&cases[2], hostile[j], report_z);
    }
    // A flux has the counts of the scene, and no fewer.
    assert_count_dropped(&cases[0], COUNT - 1, flux_ends);
    assert_count_dropped(&cases[0], 0, flux_y);
}

static void test_numbers_must_be_finite(void **context) {
    (void)context;
    static const double bad[] = {NAN, -NAN, INFINITY, -INFINITY};
    unsigned char data[CAPACITY];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        portmet_flux_t f = flux;
        double array[COUNT] = {1, 2, bad[i]};
        double **const member[] = {&f.energy_flux, &f.entropy_flux, &f.y,
                                   &f.e,           &f.eta,          &f.response};
        for (int j = 0; j < 7; ++j) {
            f = flux;
            if (j == 6) {
                f.time = bad[i];
            } else {
                *member[j] = array;
            }
            const int size = portmet_flux_t_encode(data, 0, sizeof data, &f);
            assert_drop(&cases[0], data, (size_t)size, PM_DROP_NUMBER);
            assert_int_equal(pm_flux_encode(&f, data, sizeof data), 0);
        }
    }
    unsigned char boolean[CAPACITY];
    const size_t size = pm_tick_encode(&tick, boolean, sizeof boolean);
    boolean[size - 1 - 3 * (4 + 8 * COUNT)] = 2; // `held`, before the arrays
    assert_drop(&cases[1], boolean, size, PM_DROP_NUMBER);
}

static void test_text_must_be_clean(void **context) {
    (void)context;
    const codec_case *c = &cases[4];
    unsigned char good[CAPACITY], data[CAPACITY];
    const size_t size = c->ours(good, sizeof good);
    const size_t length_at = 8 + 4 * 8 + 1 + 1;
    static const uint32_t lengths[] = {0, PM_TEXT_MAX + 2, 0x7fffffff, 0xffffffff, 0x80000000};
    for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; ++i) {
        memcpy(data, good, size);
        put(data + length_at, 4, lengths[i]);
        assert_drop(c, data, size, PM_DROP_TEXT);
    }
    static const unsigned char control[] = {0, '\n', '\t', 0x1b, 0x7f};
    for (size_t i = 0; i < sizeof control; ++i) {
        memcpy(data, good, size);
        data[length_at + 6] = control[i];
        assert_drop(c, data, size, PM_DROP_TEXT);
    }
    memcpy(data, good, size);
    data[size - 1] = 'x';
    assert_drop(c, data, size, PM_DROP_TEXT);
}

// Whatever a failure says can be sent: too long is cut, control characters become blanks.
static void test_text_is_made_clean(void **context) {
    (void)context;
    char reason[2 * PM_TEXT_MAX];
    memset(reason, 'a', sizeof reason);
    reason[sizeof reason - 1] = 0;
    reason[1] = '\n';
    portmet_command_t message = command;
    message.reason = reason;
    unsigned char data[CAPACITY];
    const size_t size = pm_command_encode(&message, data, sizeof data);
    const size_t cut = strlen(reason) - PM_TEXT_MAX;
    assert_int_equal(size, (size_t)portmet_command_t_encoded_size(&message) - cut);
    assert_drop(&cases[4], data, size, PM_KEEP);
    assert_int_equal(pm_command_decode(&message, data, size), PM_KEEP);
    assert_int_equal(strlen(message.reason), PM_TEXT_MAX);
    assert_int_equal(message.reason[1], ' ');
}

// Seeded mutations of good messages: no crash, and what is kept is canonical (see decode).
static void test_mutations(void **context) {
    (void)context;
    pm_rng rng;
    pm_rng_init(&rng, 20230801, 0);
    for (int trial = 0; trial < 200000; ++trial) {
        const codec_case *c = &cases[pm_rng_below(&rng, NCASE)];
        unsigned char data[CAPACITY] = {0};
        size_t size = c->ours(data, sizeof data);
        const uint64_t changes = pm_rng_below(&rng, 4);
        for (uint64_t i = 0; i < changes; ++i) {
            data[8 + pm_rng_below(&rng, size - 8)] = (unsigned char)pm_rng_bits(&rng);
        }
        if (pm_rng_below(&rng, 8) == 0) {
            size = pm_rng_below(&rng, size + 64);
        }
        decode(c, data, size);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bytes_equal_generated),
        cmocka_unit_test(test_capacity_is_respected),
        cmocka_unit_test(test_every_truncation_is_dropped),
        cmocka_unit_test(test_foreign_types_are_dropped),
        cmocka_unit_test(test_hostile_counts_are_dropped),
        cmocka_unit_test(test_numbers_must_be_finite),
        cmocka_unit_test(test_text_must_be_clean),
        cmocka_unit_test(test_text_is_made_clean),
        cmocka_unit_test(test_mutations),
    };
    return cmocka_run_group_tests(tests, make_memory, free_memory);
}
