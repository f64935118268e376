// Arenas, random numbers, linear algebra, activations and digests.
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"
#include "base/band.h"
#include "base/digest.h"
#include "base/elementary.h"
#include "base/linalg.h"
#include "base/path.h"
#include "base/rng.h"
#include "base/status.h"
#include "tests/support/unit.h"

static void arena_gives_zeroed_aligned_memory(void **state) {
    (void)state;
    pm_arena arena = {0};
    for (size_t size = 1; size < 100000; size = size * 3 + 1) {
        unsigned char *memory = pm_arena_alloc(&arena, size);
        assert_non_null(memory);
        assert_true((uintptr_t)memory % _Alignof(max_align_t) == 0);
        for (size_t i = 0; i < size; ++i) {
            assert_int_equal(memory[i], 0);
        }
        memset(memory, 0xff, size); // must not reach what comes next
    }
    assert_string_equal(pm_arena_printf(&arena, "%s %d", "step", 7), "step 7");
    assert_string_equal(pm_arena_strdup(&arena, ""), "");
    assert_int_equal(pm_arena_status(&arena, "nothing"), PM_OK);
    pm_arena_free(&arena);
}

static void failed_allocation_marks_the_arena(void **state) {
    (void)state;
    for (int way = 0; way < 2; ++way) {
        pm_arena arena = {0};
        assert_non_null(pm_arena_alloc(&arena, 1));
        char *text =
            way == 0 ? pm_arena_array(&arena, SIZE_MAX / 2, 4) : pm_arena_alloc(&arena, SIZE_MAX);
        assert_null(text);
        assert_null(pm_arena_alloc(&arena, 1));
        assert_null(pm_arena_array(&arena, 1, 1));
        assert_null(pm_arena_strdup(&arena, text));
        assert_null(pm_arena_printf(&arena, "%s", text));
        assert_int_equal(pm_arena_status(&arena, "%d things", 3), PM_ENOMEM);
        assert_string_equal(pm_error(), "out of memory for 3 things");
        pm_arena_free(&arena);
        assert_int_equal(pm_arena_status(&arena, "nothing"), PM_OK);
        assert_non_null(pm_arena_alloc(&arena, 1));
        pm_arena_free(&arena);
    }
    assert_int_equal(pm_allocated("memory", "nothing"), PM_OK);
    assert_int_equal(pm_allocated(NULL, "%d numbers", 7), PM_ENOMEM);
    assert_string_equal(pm_error(), "out of memory for 7 numbers");
}

// The published generator: xoshiro256** from splitmix64(0), whose first outputs are known.
static void random_numbers_are_the_published_ones(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 0, 0);
    assert_true(rng.state[0] == UINT64_C(0xe220a8397b1dcdaf));
    assert_true(rng.state[1] == UINT64_C(0x6e789e6aa1b965f4));
    rng = (pm_rng){{1, 2, 3, 4}};
    static const uint64_t expected[] = {11520, 0, 1509978240, UINT64_C(1215971899390074240)};
    for (int i = 0; i < 4; ++i) {
        assert_true(pm_rng_bits(&rng) == expected[i]);
    }
}

static void random_numbers_have_their_moments(void **state) {
    (void)state;
    enum { COUNT = 200000 };
    pm_rng rng, other;
    pm_rng_init(&rng, 1, 0);
    pm_rng_init(&other, 1, 1);
    double mean = 0, square = 0, uniform = 0;
    int bin[5] = {0}, equal = 0;
    for (int i = 0; i < COUNT; ++i) {
        const double x = pm_rng_normal(&rng), u = pm_rng_uniform(&rng);
        assert_true(u >= 0 && u < 1);
        mean += x / COUNT;
        square += x * x / COUNT;
        uniform += u / COUNT;
        ++bin[pm_rng_below(&rng, 5)];
        equal += pm_rng_bits(&rng) == pm_rng_bits(&other);
    }
    const double sigma = 1 / sqrt(COUNT); // five of it
    assert_near("mean", mean, 0, 5 * sigma);
    assert_near("variance", square, 1, 5 * sqrt(2) * sigma);
    assert_near("uniform", uniform, 0.5, 5 * sigma);
    assert_int_equal(equal, 0);
    for (int i = 0; i < 5; ++i) {
        assert_near("bin", bin[i], COUNT / 5, 5 * sqrt(COUNT * 0.16));
    }
}

static void fill(pm_rng *rng, int n, double *x) {
    for (int i = 0; i < n; ++i) {
        x[i] = pm_rng_normal(rng);
    }
}

// Both sides of the size at which BLAS takes over, all transpositions.
static void products_are_products(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 3, 0);
    static const int size[][3] = {{1, 1, 1}, {3, 5, 2}, {1, 17, 9}, {8, 8, 8}, {20, 30, 25}};
    static double a[750], b[750], c[750];
    for (size_t i = 0; i < sizeof size / sizeof *size; ++i) {
        const int m = size[i][0], n = size[i][1], k = size[i][2];
        for (int way = 0; way < 4; ++way) {
            const bool ta = way & 1, tb = way & 2;
            fill(&rng, m * k, a);
            fill(&rng, k * n, b);
            pm_gemm(ta, tb, m, n, k, a, b, c);
            for (int row = 0; row < m; ++row) {
                for (int col = 0; col < n; ++col) {
                    double sum = 0;
                    for (int l = 0; l < k; ++l) {
                        sum += (ta ? a[l * m + row] : a[row * k + l]) *
                               (tb ? b[col * k + l] : b[l * n + col]);
                    }
                    assert_near("product", c[row * n + col], sum, 1e-13);
                }
            }
        }
    }
}

// h = j^T j + 1, several blocks of the factorisation.
static void positive_systems_are_solved(void **state) {
    (void)state;
    enum { N = 150, M = 200 };
    static double j[M * N], h[N * N], kept[N * N], x[N], b[N];
    pm_rng rng;
    pm_rng_init(&rng, 4, 0);
    fill(&rng, M * N, j);
    fill(&rng, N, x);
    for (int i = 0; i < N; ++i) {
        h[i * N + i] = 1;
        h[(N - 1) * N] = 77; // below the diagonal: not to be touched
    }
    pm_gram_add(M, N, j, h);
    assert_true(h[(N - 1) * N] == 77);
    memcpy(kept, h, sizeof h);
    for (int i = 0; i < N; ++i) {
        b[i] = 0;
        for (int k = 0; k < N; ++k) {
            b[i] += (i < k ? h[i * N + k] : h[k * N + i]) * x[k];
        }
    }
    double sum = 0;
    for (int i = 0; i < M; ++i) {
        sum += j[i * N + 1] * j[i * N + 2];
    }
    assert_near("gram", h[1 * N + 2], sum, 1e-11);
    assert_true(pm_cholesky_solve(N, h, b));
    for (int i = 0; i < N; ++i) {
        assert_near("solution", b[i], x[i], 1e-9);
    }
    kept[100 * N + 100] = -1;
    assert_false(pm_cholesky_solve(N, kept, b));
}

// Against the C library, over the range of doubles that matters and beyond.
static void activations_are_accurate(void **state) {
    (void)state;
    enum { COUNT = 4001 };
    static double x[COUNT], y[COUNT];
    for (int i = 0; i < COUNT; ++i) {
        x[i] = (i - COUNT / 2) * 0.02;
    }
    x[0] = -700;
    x[COUNT - 1] = 700;
    for (int i = 0; i < COUNT; ++i) {
        y[i] = pm_tanh_of(x[i]);
        assert_near("tanh", y[i], tanh(x[i]), 8 * DBL_EPSILON * fabs(tanh(x[i])));
    }
    for (int i = 0; i < COUNT; ++i) {
        y[i] = pm_sigmoid_of(x[i]);
        assert_near("sigmoid", y[i], 1 / (1 + exp(-x[i])), 8 * DBL_EPSILON);
    }
    for (int i = 0; i < COUNT; ++i) {
        y[i] = pm_softplus_of(x[i]);
        const double expected = fmax(x[i], 0) + log1p(exp(-fabs(x[i])));
        assert_near("softplus", y[i], expected, 8 * DBL_EPSILON * (1 + fabs(expected)));
    }
    for (int i = 0; i < COUNT; ++i) {
        y[i] = pm_exp_of(x[i]);
        assert_near("exp", y[i], exp(x[i]), 8 * DBL_EPSILON * exp(x[i]));
    }
}

static void digests_tell_apart(void **state) {
    (void)state;
    // FNV-1a of "a" and its terminator, by hand.
    uint64_t expected = (PM_DIGEST_INIT ^ 'a') * UINT64_C(0x100000001b3);
    expected *= UINT64_C(0x100000001b3);
    assert_true(pm_digest_text(PM_DIGEST_INIT, "a") == expected);
    const double zero[] = {0.0, -0.0};
    const uint64_t start = PM_DIGEST_INIT;
    assert_true(pm_digest_doubles(start, zero, 1) != pm_digest_doubles(start, zero + 1, 1));
    assert_true(pm_digest_integer(start, 1) != pm_digest_integer(start, 256));
    assert_true(pm_digest_text(pm_digest_text(start, "ab"), "c") !=
                pm_digest_text(pm_digest_text(start, "a"), "bc"));
}

static void endings_are_found(void **state) {
    (void)state;
    static const struct {
        const char *path;
        size_t stem;
    } paths[] = {{"runs.d/a.h5", 8}, {"runs.d/a", 8}, {"runs.d/.h5", 10}, {"a.b.h5", 3}, {".h5", 3},
                 {"a.", 1},          {"", 0}};
    for (size_t i = 0; i < sizeof paths / sizeof *paths; ++i) {
        assert_int_equal(pm_path_stem(paths[i].path), paths[i].stem);
    }
}

static void paths_are_seen_from_files(void **state) {
    (void)state;
    static const struct {
        const char *from, *seen;
    } paths[] = {{"tests/x.yaml", "unit/test_base.c"},
                 {"tests/unit/x.yaml", "test_base.c"},
                 {"tests/u", "unit/test_base.c"},
                 {"x.yaml", "tests/unit/test_base.c"},
                 {"tests/fuzz/seeds/x", "../../unit/test_base.c"},
                 {"daemon/app/../x", "../tests/unit/test_base.c"}};
    char out[PATH_MAX];
    for (size_t i = 0; i < sizeof paths / sizeof *paths; ++i) {
        assert_string_equal(pm_path_seen_from(paths[i].from, "tests/unit/test_base.c", out),
                            paths[i].seen);
    }
    assert_string_equal(pm_path_seen_from("/proc/x", "/dev/null", out), "/dev/null");
}

static void folders_give_names(void **state) {
    (void)state;
    static const struct {
        const char *path, *name;
    } paths[] = {{"tests/unit/x.yaml", "unit"},
                 {"tests//unit//x.yaml", "unit"},
                 {"lcmtypes/x", "es"},
                 {"tests/unit/../x", "ts"},
                 {"/proc/1/x", "l_1"},
                 {"/x", "l"},
                 {"nowhere/x", "l"}};
    for (size_t i = 0; i < sizeof paths / sizeof *paths; ++i) {
        char out[24];
        const bool cut = strlen(paths[i].name) == 2;
        pm_path_folder_name(paths[i].path, "l", out, cut ? 3 : sizeof out);
        assert_string_equal(out, paths[i].name);
    }
    char here[24];
    pm_path_folder_name("x", "l", here, sizeof here);
    assert_true(here[0] != '\0' && strchr(here, '/') == NULL);
}

static void failures_are_described(void **state) {
    (void)state;
    assert_int_equal(pm_fail(PM_EDATA, "row %d: %s", 3, "bad"), PM_EDATA);
    assert_string_equal(pm_error(), "row 3: bad");
    pm_fail(PM_EDATA, "kind \"%s\"", "a\n\x1b[2Jb\x7f\xc3\xa4");
    assert_string_equal(pm_error(), "kind \"a  [2Jb \xc3\xa4\"");
}

// The solution of a band of random numbers is exact but for the single precision of the factor, for
// widths and sizes that leave a rest when columns are grouped.
static void bands_are_solved(void **state) {
    (void)state;
    enum { MOST = 40, WIDEST = 19 };
    pm_rng rng;
    pm_rng_init(&rng, 11, 0);
    for (int n = 1; n <= MOST; n += 3) {
        for (int width = 0; width < n && width <= WIDEST; ++width) {
            double band[MOST * (WIDEST + 1)], x[MOST], b[MOST] = {0};
            float factor[MOST * (WIDEST + 1)];
            for (int j = 0; j < n; ++j) {
                x[j] = pm_rng_normal(&rng);
                for (int i = 0; i <= width; ++i) {
                    band[j * (width + 1) + i] = i == 0 ? 2 * width + 2 : pm_rng_uniform(&rng);
                }
            }
            for (int j = 0; j < n; ++j) {
                for (int i = 0; i <= width && j + i < n; ++i) {
                    b[j + i] += band[j * (width + 1) + i] * x[j];
                    b[j] += i > 0 ? band[j * (width + 1) + i] * x[j + i] : 0;
                }
            }
            assert_true(pm_band_factor(n, width, band, factor));
            pm_band_solve(n, width, factor, b);
            for (int j = 0; j < n; ++j) {
                assert_near("solution of a band", b[j], x[j], 2e-6);
            }
        }
    }
    double negative[2] = {1, -1};
    float factor[2];
    assert_false(pm_band_factor(2, 0, negative, factor));
}

int main(void) {
    pm_linalg_init();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(arena_gives_zeroed_aligned_memory),
        cmocka_unit_test(failed_allocation_marks_the_arena),
        cmocka_unit_test(random_numbers_are_the_published_ones),
        cmocka_unit_test(random_numbers_have_their_moments),
        cmocka_unit_test(products_are_products),
        cmocka_unit_test(positive_systems_are_solved),
        cmocka_unit_test(activations_are_accurate),
        cmocka_unit_test(digests_tell_apart),
        cmocka_unit_test(bands_are_solved),
        cmocka_unit_test(endings_are_found),
        cmocka_unit_test(paths_are_seen_from_files),
        cmocka_unit_test(folders_give_names),
        cmocka_unit_test(failures_are_described),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
