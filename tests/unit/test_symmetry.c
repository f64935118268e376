// Symmetric copies of training samples, and the patterns that are found in the data of a mesh.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/linalg.h"
#include "learn/normalization.h"
#include "learn/objective.h"
#include "learn/symmetry.h"
#include "tests/support/random_system.h"

// 2 x 2 x 2 bricks with 18 free nodes. The groups are scalars t, vectors u, tensors sigma, and x,
// which is not a field.
#define NNODE 18
#define MESH "mesh: {size: [3, 1, 1], elements: [2, 2, 2]}\n"
#define NZ (10 * NNODE + 2)
#define NLOAD (3 * 4 * NNODE)
#define UNROLL 2
#define WIDTH ((1 + UNROLL) * NZ + UNROLL * PM_BOUNDARY_INPUT_ORDER * NLOAD)

static const char scene[] =
    "scene: one\n"
    "time: {dt: 0.1, steps: 1, integrator: euler}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {u: {unit: m, size: 54}, x: {unit: m, size: 2}, "
    "sigma: {unit: Pa, size: 108}, t: {unit: K, size: 18}}}\n"
    "boundary_inputs: {hand: {f: {unit: m, dE: \"f[0:54]\", dS: \"h[0:54]\"}, g: {unit: K, dE: "
    "\"g[0:18]\"}}}\n"
    "ports: {grip: {law: exchange, between: [hand, a], weights: b.h5, expose: {hand: [f, g], "
    "a: [u, sigma]}}}\n";
static const char part[] = MESH "energy: {nodes: [u, sigma], width: 3, passes: 1}\n"
                                "reversible: {learned: {acts_on: [u, t], nodes: [u], width: 3, "
                                "passes: 1}}\n";
#define GRIP "law: exchange\nform: free\n" MESH "rate: {nodes: [own.u], driven_by: other.dE.f, "
static const char grip[] = GRIP "width: 3, passes: 1}\n";

static pm_symmetry *make(const random_system *w, int unroll) {
    pm_symmetry *s = NULL;
    if (pm_symmetry_make(&s, w->system, unroll, PM_BOUNDARY_INPUT_ORDER, &w->scene->arena) !=
        PM_OK) {
        fail_msg("%s", pm_error());
    }
    return s;
}

static void draw(pm_rng *rng, int n, double *x) {
    for (int i = 0; i < n; ++i) {
        x[i] = pm_rng_normal(rng);
    }
}

// --- copies ---

// Copy c of a square exchanges y and z if c & 4, and then mirrors y if c & 1 and z if c & 2.
static int image_of_node(int n, int c) {
    int at[3] = {n % 2, n / 2 % 3, n / 6}; // where the value comes from
    at[1] = c & 1 ? 2 - at[1] : at[1];
    at[2] = c & 2 ? 2 - at[2] : at[2];
    return c & 4 ? at[0] + 2 * (at[2] + 3 * at[1]) : at[0] + 2 * (at[1] + 3 * at[2]);
}

// Axis k of the copy is this axis of the original, with a sign.
static int axis_of(int k, int c) {
    return k > 0 && (c & 4) ? 3 - k : k;
}
static double sign_of(int k, int c) {
    return (k == 1 && (c & 1)) || (k == 2 && (c & 2)) ? -1 : 1;
}

static void image_of_vectors(const double *from, int c, double *to) {
    for (int i = 0; i < NNODE; ++i) {
        for (int k = 0; k < 3; ++k) {
            to[3 * i + k] = sign_of(k, c) * from[3 * image_of_node(i, c) + axis_of(k, c)];
        }
    }
}

static void image_of_tensors(const double *from, int c, double *to) {
    static const int entry[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}}; // xx yy zz xy xz yz
    for (int i = 0; i < NNODE; ++i) {
        for (int k = 0; k < 3; ++k) {
            for (int l = k; l < 3; ++l) {
                to[6 * i + entry[k][l]] =
                    sign_of(k, c) * sign_of(l, c) *
                    from[6 * image_of_node(i, c) + entry[axis_of(k, c)][axis_of(l, c)]];
            }
        }
    }
}

static void image_of_scalars(const double *from, int c, double *to) {
    for (int i = 0; i < NNODE; ++i) {
        to[i] = from[image_of_node(i, c)];
    }
}

static void image_by_hand(const double *from, int c, double *to) {
    memcpy(to, from, WIDTH * sizeof *to);
    for (int at = 0; at < (1 + UNROLL) * NZ; at += NZ) {
        image_of_vectors(from + at, c, to + at);
        image_of_tensors(from + at + 56, c, to + at + 56);
        image_of_scalars(from + at + 56 + 6 * NNODE, c, to + at + 56 + 6 * NNODE);
    }
    // For each power of time: values and co-energies of energy and entropy, each for f and g.
    for (int at = (1 + UNROLL) * NZ; at < WIDTH; at += 4 * NNODE) {
        image_of_vectors(from + at, c, to + at);
        image_of_scalars(from + at + 3 * NNODE, c, to + at + 3 * NNODE);
    }
}

static void images_turn_and_mirror_every_field(void **state) {
    (void)state;
    random_system w;
    random_system_of_text(&w, 1, scene, part, grip);
    assert_true(w.scene->nz == NZ && w.scene->nprescribed == NLOAD);
    const pm_symmetry *s = make(&w, UNROLL);
    static double window[WIDTH], image[WIDTH], expected[WIDTH];
    draw(&w.rng, WIDTH, window);
    for (int c = 0; c < PM_SYMMETRY_COPIES_OF_SQUARE; ++c) {
        image_by_hand(window, c, expected);
        pm_symmetry_image(s, c, WIDTH, window, image);
        for (int i = 0; i < WIDTH; ++i) {
            if (image[i] != expected[i]) {
                random_system_fail(&w, "copy %d: number %d is %g, expected %g", c, i, image[i],
                                   expected[i]);
            }
        }
        assert_int_equal(memcmp(image, window, sizeof window) == 0, c == 0);
    }
    random_system_close(&w);
}

// The inverse of a quarter turn is the opposite turn; every other copy is its own inverse.
static void an_image_of_an_image_is_the_window(void **state) {
    (void)state;
    static const int inverse[PM_SYMMETRY_COPIES_OF_SQUARE] = {0, 1, 2, 3, 4, 6, 5, 7};
    random_system w;
    random_system_of_text(&w, 2, scene, part, grip);
    const pm_symmetry *s = make(&w, UNROLL);
    static double window[WIDTH], image[WIDTH], back[WIDTH];
    draw(&w.rng, WIDTH, window);
    for (int c = 0; c < PM_SYMMETRY_COPIES_OF_SQUARE; ++c) {
        pm_symmetry_image(s, c, WIDTH, window, image);
        pm_symmetry_image(s, inverse[c], WIDTH, image, back);
        assert_memory_equal(back, window, sizeof window);
    }
    random_system_close(&w);
}

// --- samples and their loss ---

#define COUNT 3

typedef struct bench {
    random_system w;
    pm_samples samples;
    double z[COUNT * WIDTH], scale[NZ];
    pm_objective *objective;
} bench;

static void bench_open(bench *b) {
    random_system_of_text(&b->w, 3, scene, part, grip);
    draw(&b->w.rng, COUNT * WIDTH, b->z);
    for (int i = 0; i < NZ; ++i) {
        b->scale[i] = 1;
    }
    b->samples = (pm_samples){.count = COUNT,
                              .unroll = UNROLL,
                              .nz = NZ,
                              .nboundary_input = NLOAD,
                              .input_order = PM_BOUNDARY_INPUT_ORDER,
                              .z = b->z,
                              .scale = b->scale};
    const pm_loss loss = {
        .residual = PM_RESIDUAL_STEP, .integrator = pm_integrator_find("euler"), .substeps = 1};
    b->objective = NULL;
    assert_int_equal(pm_objective_open(&b->objective, b->w.system, &b->samples, &loss), PM_OK);
}

static void bench_close(bench *b) {
    pm_objective_close(b->objective);
    random_system_close(&b->w);
}

static double *gradient_of(const bench *b) {
    double *gradient =
        pm_arena_array(&b->w.scene->arena, (size_t)pm_objective_size(b->objective), sizeof(double));
    assert_non_null(gradient);
    return gradient;
}

static void the_loss_of_an_image_is_that_of_the_turned_window(void **state) {
    (void)state;
    static bench plain, turned;
    bench_open(&plain);
    bench_open(&turned);
    turned.samples.symmetry = make(&turned.w, UNROLL);
    assert_int_equal(pm_objective_symmetry_copies(plain.objective), COUNT);
    assert_int_equal(pm_objective_symmetry_copies(turned.objective), 8 * COUNT);
    const int size = pm_objective_size(plain.objective), image = 5, second = 2;
    double *expected = gradient_of(&plain), *gradient = gradient_of(&turned);
    double by_hand[WIDTH];
    image_by_hand(plain.z + second * (ptrdiff_t)WIDTH, image, by_hand);
    const double before = pm_objective_evaluate(plain.objective, 1, &second, expected);
    memcpy(plain.z + second * (ptrdiff_t)WIDTH, by_hand, sizeof by_hand);
    const double loss = pm_objective_evaluate(plain.objective, 1, &second, expected);
    const int index = image * COUNT + second;
    const double found = pm_objective_evaluate(turned.objective, 1, &index, gradient);
    assert_true(found == loss && before != loss);
    assert_memory_equal(gradient, expected, (size_t)size * sizeof *gradient);
    bench_close(&plain);
    bench_close(&turned);
}

// --- refusals ---

static void what_is_not_square_is_refused(void **state) {
    (void)state;
    static const struct {
        const char *part, *port, *words;
    } bad[] = {
        {"energy: {features: [\"|u|^2\"], skip: linear}\n", "law: exchange\nform: free\nrate: {}\n",
         "symmetry: no model has a mesh"},
        {"mesh: {size: [3, 1, 1.5], elements: [2, 2, 2]}\nenergy: {nodes: u, width: 1, passes: "
         "0}\n",
         "law: exchange\nform: free\nrate: {}\n", "symmetry: the mesh has no square section"},
        {"mesh: {size: [3, 1, 1], elements: [3, 2, 1]}\nenergy: {nodes: u, width: 1, passes: 0}\n",
         "law: exchange\nform: free\nrate: {}\n", "symmetry: the mesh has no square section"},
        {part,
         "law: exchange\nform: free\nmesh: {size: [3, 1, 1], elements: [1, 2, 2]}\n"
         "rate: {nodes: [own.u], width: 1, passes: 0}\n",
         "symmetry: grip has another mesh than the models before it"},
        {"mesh: {size: [3, 1, 1.5], elements: [2, 2, 2]}\nenergy: {nodes: u, width: 1, passes: "
         "0}\n",
         grip, "symmetry: grip has another mesh than the models before it"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        random_system w;
        pm_symmetry *s = NULL;
        random_system_of_text(&w, 1, scene, bad[i].part, bad[i].port);
        assert_int_equal(pm_symmetry_make(&s, w.system, 1, 1, &w.scene->arena), PM_ECONFIG);
        if (s != NULL || strcmp(pm_error(), bad[i].words) != 0) {
            random_system_fail(&w, "error \"%s\", expected \"%s\"", pm_error(), bad[i].words);
        }
        random_system_close(&w);
    }
}

// --- patterns ---

#define RANK 3
#define STATES 40

// Makes windows whose u is a combination of RANK fields.
static void draw_of_rank(bench *b, double basis[RANK][3 * NNODE], double *z) {
    for (int k = 0; k < RANK; ++k) {
        draw(&b->w.rng, 3 * NNODE, basis[k]);
    }
    for (int i = 0; i < STATES; ++i) {
        double *window = z + (ptrdiff_t)i * WIDTH;
        draw(&b->w.rng, WIDTH, window);
        for (int c = 0; c < 3 * NNODE; ++c) {
            window[c] = 0;
        }
        for (int k = 0; k < RANK; ++k) {
            const double amplitude = pm_rng_normal(&b->w.rng);
            for (int c = 0; c < 3 * NNODE; ++c) {
                window[c] += amplitude * basis[k][c];
            }
        }
    }
}

// The norm of x after its projection on the columns of `pattern` [3 NNODE][count] is subtracted.
static double remainder_of(const double *x, const double *pattern, int count) {
    double rest[3 * NNODE], square = 0, whole = 0;
    memcpy(rest, x, sizeof rest);
    for (int k = 0; k < count; ++k) {
        double work = 0, length = 0;
        for (int c = 0; c < 3 * NNODE; ++c) {
            work += rest[c] * pattern[c * count + k];
            length += pattern[c * count + k] * pattern[c * count + k];
        }
        for (int c = 0; c < 3 * NNODE; ++c) {
            rest[c] -= work / length * pattern[c * count + k];
        }
    }
    for (int c = 0; c < 3 * NNODE; ++c) {
        square += rest[c] * rest[c];
        whole += x[c] * x[c];
    }
    return sqrt(square / whole);
}

static void patterns_span_the_data(void **state) {
    (void)state;
    static const char patterned[] = MESH "energy: {nodes: [u], width: 3, passes: 0, patterns: 3}\n";
    static double z[STATES * WIDTH], basis[RANK][3 * NNODE];
    static bench b;
    b = (bench){0};
    random_system_of_text(&b.w, 5, scene, patterned, grip);
    draw_of_rank(&b, basis, z);
    const pm_samples samples = {.count = STATES,
                                .unroll = UNROLL,
                                .nz = NZ,
                                .nboundary_input = NLOAD,
                                .input_order = PM_BOUNDARY_INPUT_ORDER,
                                .z = z};
    assert_int_equal(pm_normalization_of_system(b.w.system, &samples, true), PM_OK);
    const pm_params *params = &b.w.system->part[0]->params;
    const pm_param_entry *found = pm_params_find(params, "energy.0.field0.patterns");
    assert_true(found != NULL && found->rows == 3 * NNODE && found->cols == RANK);
    assert_false(found->trained);
    for (int k = 0; k < RANK; ++k) {
        double square = 0;
        for (int c = 0; c < 3 * NNODE; ++c) {
            square += found->value[c * RANK + k] * found->value[c * RANK + k] / (3 * NNODE);
        }
        random_system_check(&b.w, "mean square of a pattern", square, 1, 1e-6); // single precision
        random_system_check(&b.w, "rest of the data", remainder_of(basis[k], found->value, RANK), 0,
                            1e-6);
    }
    random_system_close(&b.w);
}

// One state in four is five times as large as the others, but the others determine the patterns.
static void small_states_count_as_large_ones_do(void **state) {
    (void)state;
    static const char patterned[] = MESH "energy: {nodes: [u], width: 3, passes: 0, patterns: 1}\n";
    static double z[STATES * WIDTH], basis[RANK][3 * NNODE];
    static bench b;
    b = (bench){0};
    random_system_of_text(&b.w, 6, scene, patterned, grip);
    draw_of_rank(&b, basis, z);
    for (int i = 0; i < STATES; ++i) {
        for (int c = 0; c < 3 * NNODE; ++c) {
            z[i * WIDTH + c] = i % 4 == 0 ? 5 * basis[0][c] : basis[1][c];
        }
    }
    const pm_samples samples = {.count = STATES,
                                .unroll = UNROLL,
                                .nz = NZ,
                                .nboundary_input = NLOAD,
                                .input_order = PM_BOUNDARY_INPUT_ORDER,
                                .z = z};
    assert_int_equal(pm_normalization_of_system(b.w.system, &samples, true), PM_OK);
    const pm_params *params = &b.w.system->part[0]->params;
    const double *pattern = pm_params_find(params, "energy.0.field0.patterns")->value;
    assert_true(remainder_of(basis[1], pattern, 1) < 0.5 * remainder_of(basis[0], pattern, 1));
    random_system_close(&b.w);
}

static void more_patterns_than_states_are_refused(void **state) {
    (void)state;
    static const char patterned[] = MESH "energy: {nodes: [u], width: 3, passes: 0, patterns: 9}\n";
    static bench b;
    b = (bench){0};
    random_system_of_text(&b.w, 5, scene, patterned, grip);
    draw(&b.w.rng, COUNT * WIDTH, b.z);
    const pm_samples samples = {.count = COUNT,
                                .unroll = UNROLL,
                                .nz = NZ,
                                .nboundary_input = NLOAD,
                                .input_order = PM_BOUNDARY_INPUT_ORDER,
                                .z = b.z};
    assert_int_equal(pm_normalization_of_system(b.w.system, &samples, true), PM_EDATA);
    assert_non_null(strstr(pm_error(), "9 patterns cannot be found in 3 states"));
    random_system_close(&b.w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(images_turn_and_mirror_every_field),
        cmocka_unit_test(an_image_of_an_image_is_the_window),
        cmocka_unit_test(the_loss_of_an_image_is_that_of_the_turned_window),
        cmocka_unit_test(what_is_not_square_is_refused),
        cmocka_unit_test(patterns_span_the_data),
        cmocka_unit_test(small_states_count_as_large_ones_do),
        cmocka_unit_test(more_patterns_than_states_are_refused),
    };
    pm_linalg_init();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
