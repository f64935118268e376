// The loss of the trainer: its gradient, its normal equations, and equal bits for any order of its
// threads.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "graph/program.h"
#include "optimise/normal_equations.h"
#include "optimise/optimiser.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define COUNT 150 // samples: several chunks of each lane, and a rest
#define UNROLL 2
#define NZ 10
#ifdef PM_SANITIZED // which look for faults of memory: fewer numbers take the same code
#define DIRECTIONS 2
#define REPETITIONS 2
#define ESTIMATES 0
#else
#define DIRECTIONS 12
#define REPETITIONS 10
#define ESTIMATES 60
#endif
#define STEP 1e-5
// The error of central differences: STEP^2 times a third derivative, and rounding of 1e-16 / STEP.
#define TOLERANCE 1e-6
// The tolerance for equal derivatives from two programs.
#define SAME_TOLERANCE 1e-11

static const char soft_part[] =
    "form: soft\n"
    "energy: {features: [q, p, s], hidden: [6], skip: linear}\n"
    "entropy: {features: [q, s], hidden: [4], skip: linear}\n"
    "reversible: {given: [[q, p, 1.0]], learned: {acts_on: [p, s], features: [q], hidden: [3]}}\n"
    "irreversible: {learned: {acts_on: [p, s], features: [s], hidden: [3]}}\n";

static const char soft_port[] =
    "law: bracket\n"
    "form: soft\n"
    "reversible: {learned: {acts_on: [a.p, b.q], features: [a.s, b.s], hidden: [3]}}\n"
    "irreversible: {learned: {acts_on: [a.s, b.s]}}\n";

// The loss of a random system on random windows.
typedef struct bench {
    random_system w;
    pm_samples samples;
    double z[COUNT * (1 + UNROLL) * NZ], scale[NZ];
    int index[COUNT]; // the samples in some order
    pm_loss loss;
    pm_objective *objective;
    int size;
    double *theta, *gradient;
} bench;

static void fill_windows(bench *b) {
    for (int i = 0; i < COUNT; ++i) {
        for (int k = 0; k < (1 + UNROLL) * NZ; ++k) {
            const int at = i * (1 + UNROLL) * NZ + k;
            b->z[at] = k < NZ ? 0.5 * pm_rng_normal(&b->w.rng)
                              : b->z[at - NZ] + 0.005 * pm_rng_normal(&b->w.rng);
        }
        b->index[i] = (i * 7) % COUNT; // 7 and COUNT have no common factor
    }
    for (int i = 0; i < NZ; ++i) {
        b->scale[i] = 0.01 + 0.005 * i;
    }
    b->samples =
        (pm_samples){.count = COUNT, .unroll = UNROLL, .nz = NZ, .z = b->z, .scale = b->scale};
}

static void bench_open(bench *b, uint64_t seed, bool soft, double robust) {
    random_system_of_text(&b->w, seed, random_system_scene, soft ? soft_part : random_system_part,
                          soft ? soft_port : random_system_port);
    b->w.scene->physics.dt = 0.002; // short enough for random models
    fill_windows(b);
    b->loss = (pm_loss){.residual = PM_RESIDUAL_STEP,
                        .integrator = pm_integrator_find("heun"),
                        .substeps = 2,
                        .degeneracy = 0.7,
                        .robust = robust};
    b->objective = NULL;
    assert_int_equal(pm_objective_open(&b->objective, b->w.system, &b->samples, &b->loss), PM_OK);
    b->size = pm_objective_size(b->objective);
    b->theta = malloc((size_t)b->size * sizeof *b->theta);
    b->gradient = malloc((size_t)b->size * sizeof *b->gradient);
    assert_true(b->theta != NULL && b->gradient != NULL);
    pm_objective_weights(b->objective, b->theta);
    pm_objective_evaluate(b->objective, 0, NULL, b->gradient);
    assert_int_equal(pm_objective_rescale(b->objective, 0, NULL), PM_OK);
}

static void bench_close(bench *b) {
    pm_objective_close(b->objective);
    free(b->theta);
    free(b->gradient);
    random_system_close(&b->w);
}

static double *vector(int n) {
    double *v = calloc((size_t)n, sizeof *v);
    assert_non_null(v);
    return v;
}

// Draws a direction in weight space; every other one has a single nonzero weight.
static void draw_direction(bench *b, int i, double *v) {
    memset(v, 0, (size_t)b->size * sizeof *v);
    if (i % 2 == 0) {
        v[pm_rng_below(&b->w.rng, (uint64_t)b->size)] = 1;
        return;
    }
    for (int k = 0; k < b->size; ++k) {
        v[k] = pm_rng_normal(&b->w.rng) / sqrt(b->size);
    }
}

static void move_weights(bench *b, double step, const double *v) {
    double *theta = vector(b->size);
    for (int k = 0; k < b->size; ++k) {
        theta[k] = b->theta[k] + step * v[k];
    }
    pm_objective_set_weights(b->objective, theta);
    free(theta);
}

static double dot(int n, const double *x, const double *y) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += x[i] * y[i];
    }
    return sum;
}

// --- the gradient ---

static void check_gradient(uint64_t seed, bool soft, double robust) {
    bench b;
    bench_open(&b, seed, soft, robust);
    double *v = vector(b.size), *ignored = vector(b.size);
    pm_objective_evaluate(b.objective, COUNT, b.index, b.gradient);
    const double size = sqrt(dot(b.size, b.gradient, b.gradient));
    for (int i = 0; i < DIRECTIONS; ++i) {
        draw_direction(&b, i, v);
        double loss[2];
        for (int side = 0; side < 2; ++side) {
            move_weights(&b, side == 0 ? -STEP : STEP, v);
            loss[side] = pm_objective_evaluate(b.objective, COUNT, b.index, ignored);
        }
        random_system_check(&b.w, "derivative of the loss", dot(b.size, b.gradient, v),
                            (loss[1] - loss[0]) / (2 * STEP), TOLERANCE * size);
    }
    free(v);
    free(ignored);
    bench_close(&b);
}

static void gradient_is_the_derivative_of_the_loss(void **state) {
    (void)state;
    for (int i = 0; i < 8; ++i) {
        check_gradient((uint64_t)i + 1, i % 2 == 1, i >= 4 ? 2 : 0);
    }
}

// --- the normal equations ---

#define MOST_PENALTIES 80 // components of L dS and M dE after all steps
#define ROWS (UNROLL * NZ + MOST_PENALTIES)
// A graph of the residuals [COUNT][ROWS] of all samples. Their squares sum to COUNT times the loss.
typedef struct residuals {
    pm_graph *g;
    pm_program *program;
    pm_loss_nodes nodes;
} residuals;

static void residuals_open(residuals *r, const bench *b) {
    assert_int_equal(pm_graph_open(&r->g), PM_OK);
    assert_int_equal(pm_loss_graph_build(r->g, b->w.system, &b->samples, &b->loss, &r->nodes),
                     PM_OK);
    const pm_node output[] = {r->nodes.residual, r->nodes.degeneracy};
    const int count = output[1] == PM_NO_NODE ? 1 : 2;
    assert_int_equal(pm_program_open(&r->program, r->g, count, output, COUNT), PM_OK);
    memcpy(pm_program_value(r->program, r->nodes.input), b->z, sizeof b->z);
}

static void residuals_close(residuals *r) {
    pm_program_close(r->program);
    pm_graph_close(r->g);
}

static void residuals_at(residuals *r, bench *b, double step, const double *v, double *result) {
    move_weights(b, step, v);
    pm_program_run(r->program, COUNT);
    const double *residual = pm_program_value(r->program, r->nodes.residual);
    const double scale = sqrt(b->loss.degeneracy);
    const pm_node node = r->nodes.degeneracy;
    const int n = node == PM_NO_NODE ? 0 : pm_graph_shape(r->g, node).cols;
    assert_true(n <= MOST_PENALTIES);
    for (int i = 0; i < COUNT; ++i) {
        double *row = result + (ptrdiff_t)i * ROWS;
        for (int k = 0; k < UNROLL * NZ; ++k) {
            *row++ = residual[i * UNROLL * NZ + k] / sqrt(UNROLL * NZ);
        }
        for (int k = 0; k < MOST_PENALTIES; ++k) {
            *row++ = k < n ? scale * pm_program_value(r->program, node)[i * n + k] : 0;
        }
    }
}

// Computes J v, where the rows of each sample are multiplied by the root of its weight.
static void jacobian_times(residuals *r, bench *b, const double *v, double *Jv) {
    double *below = vector(COUNT * ROWS);
    residuals_at(r, b, -STEP, v, below);
    residuals_at(r, b, STEP, v, Jv);
    for (int i = 0; i < COUNT * ROWS; ++i) {
        Jv[i] = (Jv[i] - below[i]) / (2 * STEP) *
                sqrt(pm_objective_sample_weight(b->objective, i / ROWS));
    }
    free(below);
}

// Computes H v from the upper triangle of H.
static void matrix_times(int n, const double *H, const double *v, double *Hv) {
    for (int i = 0; i < n; ++i) {
        Hv[i] = 0;
        for (int j = 0; j < n; ++j) {
            const int row = i < j ? i : j, col = i < j ? j : i;
            Hv[i] += H[(ptrdiff_t)row * n + col] * v[j];
        }
    }
}

static void check_hessian(bench *b, const double *H) {
    residuals r;
    residuals_open(&r, b);
    double *u = vector(b->size), *v = vector(b->size), *Hv = vector(b->size);
    double *Ju = vector(COUNT * ROWS), *Jv = vector(COUNT * ROWS);
    for (int i = 0; i < DIRECTIONS; ++i) {
        draw_direction(b, i, u);
        draw_direction(b, i + 1, v);
        jacobian_times(&r, b, u, Ju);
        jacobian_times(&r, b, v, Jv);
        const double scale = sqrt(dot(COUNT * ROWS, Ju, Ju) * dot(COUNT * ROWS, Jv, Jv)) / COUNT;
        matrix_times(b->size, H, v, Hv);
        random_system_check(&b->w, "u^T H v", dot(b->size, u, Hv),
                            dot(COUNT * ROWS, Ju, Jv) / COUNT, 10 * TOLERANCE * (scale + 1e-3));
    }
    free(u);
    free(v);
    free(Hv);
    free(Ju);
    free(Jv);
    residuals_close(&r);
}

static void check_normal(uint64_t seed, bool soft, double robust) {
    bench b;
    bench_open(&b, seed, soft, robust);
    double *gradient = vector(b.size), *H = vector(b.size * b.size);
    pm_gauss_newton *normal = NULL;
    assert_int_equal(pm_gauss_newton_open(&normal, b.objective, true, NULL), PM_OK);
    pm_objective_evaluate(b.objective, COUNT, b.index, b.gradient);
    pm_gauss_newton_evaluate(normal, COUNT, b.index, gradient, H);
    const double size = sqrt(dot(b.size, b.gradient, b.gradient));
    for (int k = 0; k < b.size; ++k) {
        random_system_check(&b.w, "gradient of half the loss", gradient[k], b.gradient[k] / 2,
                            SAME_TOLERANCE * size);
    }
    // The robust weights of samples are those of this evaluation, also after the weights change.
    check_hessian(&b, H);
    pm_gauss_newton_close(normal);
    free(gradient);
    free(H);
    bench_close(&b);
}

static void normal_equations_are_those_of_the_residuals(void **state) {
    (void)state;
    for (int i = 0; i < 4; ++i) {
        check_normal((uint64_t)i + 1, i == 1, i >= 2 ? 2 : 0);
    }
}

// Checks that estimates of the diagonal of H have the right mean. Where few samples make an entry,
// an estimate has a relative error of up to sqrt(2), and the mean of 60 has 0.18.
static void check_diagonal(bench *b, pm_gauss_newton *product, const double *H) {
    double *gradient = vector(3 * b->size), *estimate = gradient + b->size,
           *mean = estimate + b->size;
    for (int k = 0; k < ESTIMATES; ++k) {
        pm_gauss_newton_linearise(product, COUNT, b->index, (uint64_t)k, gradient, estimate);
        for (int i = 0; i < b->size; ++i) {
            mean[i] += estimate[i] / ESTIMATES;
        }
    }
    for (int i = 0; i < b->size; ++i) {
        const double exact = H[(ptrdiff_t)i * b->size + i];
        random_system_check(&b->w, "diagonal of H", mean[i], exact, 0.75 * exact + 1e-12);
    }
    free(gradient);
}

static void check_products(uint64_t seed, bool soft, double robust) {
    bench b;
    bench_open(&b, seed, soft, robust);
    double *gradient = vector(5 * b.size), *same = gradient + b.size, *diagonal = same + b.size,
           *v = diagonal + b.size, *Hv = v + b.size, *H = vector(b.size * b.size);
    pm_gauss_newton *matrix = NULL;
    pm_gauss_newton *product = NULL;
    assert_int_equal(pm_gauss_newton_open(&matrix, b.objective, true, NULL), PM_OK);
    assert_int_equal(pm_gauss_newton_open(&product, b.objective, false, NULL), PM_OK);
    pm_objective_evaluate(b.objective, COUNT, b.index, b.gradient);
    pm_gauss_newton_evaluate(matrix, COUNT, b.index, gradient, H);
    pm_gauss_newton_linearise(product, COUNT, b.index, 1, same, diagonal);
    const double size = sqrt(dot(b.size, gradient, gradient));
    for (int k = 0; k < b.size; ++k) {
        random_system_check(&b.w, "gradient", same[k], gradient[k], SAME_TOLERANCE * size);
    }
    for (int i = 0; i < DIRECTIONS; ++i) {
        draw_direction(&b, i, v);
        matrix_times(b.size, H, v, Hv);
        pm_gauss_newton_apply(product, COUNT, b.index, v, same);
        const double length = sqrt(dot(b.size, Hv, Hv));
        for (int k = 0; k < b.size; ++k) {
            random_system_check(&b.w, "H v", same[k], Hv[k], SAME_TOLERANCE * (length + size));
        }
    }
    if (seed == 1 && ESTIMATES > 0) {
        check_diagonal(&b, product, H); // slow
    }
    pm_gauss_newton_close(matrix);
    pm_gauss_newton_close(product);
    free(gradient);
    free(H);
    bench_close(&b);
}

static void products_are_those_of_the_matrix(void **state) {
    (void)state;
    for (int i = 0; i < 4; ++i) {
        check_products((uint64_t)i + 1, i == 1, i >= 2 ? 2 : 0);
    }
}

// Returns the decrease of the quadratic model of the loss by the step of one of the solvers.
static double decrease(bench *b, bool matrix, const double *H, double damping) {
    pm_damped_equations e;
    double *step = vector(2 * b->size), *Hx = step + b->size;
    pm_objective_evaluate(b->objective, COUNT, b->index, b->gradient);
    assert_int_equal(pm_damped_equations_open(&e, b->objective, 0, matrix, NULL), PM_OK);
    pm_damped_equations_linearise(&e, COUNT, b->index, 1, 0, b->theta);
    assert_true(pm_damped_equations_solve(&e, b->theta, damping, 100, step));
    matrix_times(b->size, H, step, Hx);
    double model = dot(b->size, e.gradient, step) + 0.5 * dot(b->size, step, Hx);
    for (int i = 0; i < b->size; ++i) {
        model += 0.5 * damping * H[(ptrdiff_t)i * (b->size + 1)] * step[i] * step[i];
    }
    pm_damped_equations_close(&e);
    free(step);
    return -model;
}

// With strong damping the systems of both solvers differ by their diagonals alone, whose estimate
// has errors; with weak damping the diagonals hardly matter.
static void conjugate_gradients_find_the_step(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 3, true, 0);
    double *gradient = vector(b.size), *H = vector(b.size * b.size);
    pm_gauss_newton *matrix = NULL;
    assert_int_equal(pm_gauss_newton_open(&matrix, b.objective, true, NULL), PM_OK);
    pm_objective_evaluate(b.objective, COUNT, b.index, b.gradient);
    pm_gauss_newton_evaluate(matrix, COUNT, b.index, gradient, H);
    for (double damping = 1e-4; damping < 20; damping *= 100) {
        const double exact = decrease(&b, true, H, damping);
        const double found = decrease(&b, false, H, damping);
        if (!(exact > 0 && found > 0.8 * exact && found <= exact * (1 + 1e-9))) {
            random_system_fail(&b.w, "damping %g: the model falls by %g, with a matrix by %g",
                               damping, found, exact);
        }
    }
    pm_gauss_newton_close(matrix);
    free(gradient);
    free(H);
    bench_close(&b);
}

// --- acceleration ---

// Returns v.H v of the loss at theta + t v.
static double power_at(bench *b, pm_gauss_newton *normal, double t, const double *v, double *work) {
    const ptrdiff_t n = b->size;
    double *theta = work, *gradient = work + n, *Hv = work + 2 * n, *H = work + 3 * n;
    for (ptrdiff_t i = 0; i < n; ++i) {
        theta[i] = b->theta[i] + t * v[i];
    }
    pm_objective_set_weights(b->objective, theta);
    pm_objective_evaluate(b->objective, COUNT, b->index, NULL);
    pm_gauss_newton_evaluate(normal, COUNT, b->index, gradient, H);
    matrix_times((int)n, H, v, Hv);
    return dot((int)n, v, Hv);
}

// Along theta + t v the square of J v is v.H v, and half its derivative is v.J^T r''. An
// accelerated step is v + a with (H + D damping) a = -J^T r''/2, up to what keeps the equations
// regular.
static void steps_bend_as_the_jacobian_changes(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 2, true, 0);
    const double h = 1e-4, damping = 3e3; // so that steps are short
    double *v = vector(3 * b.size), *step = v + b.size, *Ha = step + b.size,
           *work = vector((3 + b.size) * b.size), *H = vector(b.size * b.size);
    pm_gauss_newton *normal = NULL;
    pm_damped_equations e;
    assert_int_equal(pm_gauss_newton_open(&normal, b.objective, true, NULL), PM_OK);
    assert_int_equal(pm_damped_equations_open(&e, b.objective, COUNT, true, NULL), PM_OK);
    pm_objective_evaluate(b.objective, COUNT, b.index, b.gradient);
    pm_gauss_newton_evaluate(normal, COUNT, b.index, b.gradient, H);
    pm_damped_equations_linearise(&e, COUNT, b.index, 1, 0, b.theta);
    e.accelerates = false;
    assert_true(pm_damped_equations_solve(&e, b.theta, damping, 0, v));
    e.accelerates = true;
    assert_true(pm_damped_equations_solve(&e, b.theta, damping, 0, step));
    for (int k = 0; k < b.size; ++k) {
        step[k] -= v[k];
    }
    matrix_times(b.size, H, step, Ha);
    double pulled = dot(b.size, v, Ha);
    for (int k = 0; k < b.size; ++k) {
        pulled += damping * e.diagonal[k] * v[k] * step[k];
    }
    const double above = power_at(&b, normal, h, v, work);
    const double below = power_at(&b, normal, -h, v, work);
    const double expected = -(above - below) / (8 * h);
    assert_true(fabs(expected) > 0);
    random_system_check(&b.w, "v.J^T r''/2", pulled, expected, 1e-2 * fabs(expected));
    pm_gauss_newton_close(normal);
    pm_damped_equations_close(&e);
    free(v);
    free(work);
    free(H);
    bench_close(&b);
}

// --- threads ---

static void threads_do_not_change_a_bit(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 5, true, 2);
    const size_t n = (size_t)b.size;
    double *gradient = vector(b.size), *H = vector(b.size * b.size),
           *again = vector(b.size * b.size);
    pm_gauss_newton *normal = NULL;
    assert_int_equal(pm_gauss_newton_open(&normal, b.objective, true, NULL), PM_OK);
    const double loss = pm_objective_evaluate(b.objective, COUNT, b.index, b.gradient);
    pm_gauss_newton_evaluate(normal, COUNT, b.index, gradient, H);
    for (int i = 0; i < REPETITIONS; ++i) {
        const double repeated = pm_objective_evaluate(b.objective, COUNT, b.index, again);
        assert_memory_equal(&repeated, &loss, sizeof loss);
        assert_memory_equal(again, b.gradient, n * sizeof *again);
        pm_gauss_newton_evaluate(normal, COUNT, b.index, gradient, again);
        assert_memory_equal(again, H, n * n * sizeof *again);
    }
    pm_gauss_newton_close(normal);
    free(gradient);
    free(H);
    free(again);
    bench_close(&b);
}

// --- training the soft form ---

static pm_status go_on(void *context, const pm_optimisation *o, double loss) {
    (void)context, (void)o, (void)loss;
    return PM_OK;
}

// Computes the loss at the weights of the system with this weight of the penalty.
static double loss_with(bench *b, double degeneracy) {
    pm_objective *objective = NULL;
    pm_loss loss = b->loss;
    loss.degeneracy = degeneracy;
    assert_int_equal(pm_objective_open(&objective, b->w.system, &b->samples, &loss), PM_OK);
    const double value = pm_objective_evaluate(objective, 0, NULL, b->gradient);
    pm_objective_close(objective);
    return value;
}

// Runs a few iterations in one piece, or in two, and writes the weights to theta.
static void train_by_products(bool interrupted, double *theta, double *before, double *after) {
    bench b;
    bench_open(&b, 6, true, 0);
    double *moment = vector(2 * b.size);
    pm_optimisation o = {
        .objective = b.objective,
        .schedule = {.iterations = interrupted ? 3 : 6, .batch = 100, .guarded = true},
        .seed = 1,
        .theta = b.theta,
        .moment = moment,
        .report = go_on};
    *before = loss_with(&b, 1);
    assert_int_equal(pm_optimiser_find("gauss_newton_cg")->run(&o), PM_OK);
    o.schedule.iterations = 6;
    assert_int_equal(pm_optimiser_find("gauss_newton_cg")->run(&o), PM_OK);
    *after = loss_with(&b, 1);
    memcpy(theta, b.theta, (size_t)b.size * sizeof *theta);
    free(moment);
    bench_close(&b);
}

static void training_by_products_lowers_the_loss_and_resumes(void **state) {
    (void)state;
    double theta[2][1000] = {{0}}, before, after;
    train_by_products(false, theta[0], &before, &after);
    train_by_products(true, theta[1], &before, &after);
    assert_true(after < 0.7 * before);
    assert_memory_equal(theta[0], theta[1], sizeof theta[0]);
}

static void training_lowers_the_penalty(void **state) {
    (void)state;
    bench b;
    bench_open(&b, 6, true, 0);
    const double before = loss_with(&b, 1) - loss_with(&b, 0);
    double *moment = vector(2 * b.size);
    pm_optimisation o = {.objective = b.objective,
                         .schedule = {.iterations = 40,
                                      .batch = 32,
                                      .first_rate = 1e-2,
                                      .last_rate = 1e-3,
                                      .beta2 = 0.999},
                         .seed = 1,
                         .theta = b.theta,
                         .moment = moment,
                         .report = go_on};
    assert_int_equal(pm_optimiser_find("adam")->run(&o), PM_OK);
    const double after = loss_with(&b, 1) - loss_with(&b, 0);
    if (!(before > 0 && after < 0.5 * before)) {
        random_system_fail(&b.w, "penalty %g before training, %g after, expected less than half",
                           before, after);
    }
    free(moment);
    bench_close(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradient_is_the_derivative_of_the_loss),
        cmocka_unit_test(normal_equations_are_those_of_the_residuals),
        cmocka_unit_test(products_are_those_of_the_matrix),
        cmocka_unit_test(conjugate_gradients_find_the_step),
        cmocka_unit_test(training_by_products_lowers_the_loss_and_resumes),
        cmocka_unit_test(steps_bend_as_the_jacobian_changes),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(training_lowers_the_penalty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
