// The search over hypotheses: the data decide, a hypothesis that cannot be fitted does no harm, and
// the same input gives the same file.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/linalg.h"
#include "propose/search.h"
#include "store/dataset.h"
#include "tests/support/unit.h"

#define NTRAJECTORY 6
#define NTIME 60
#define DT 0.05
#define STIFF 1.5 // the force of the spring is -q - STIFF q^3
#define TEXT 8192

static const char *start; // of the file of the winner
static char folder[] = "/tmp/test_searchXXXXXX";

static void path_of(const char *name, char path[64]) {
    snprintf(path, 64, "%s/%s", folder, name);
}

// A mass on a cubic spring, by many small steps of the leapfrog method.
static void write_data(const char *path) {
    static const char *const column[] = {"q", "p"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, NTRAJECTORY, NTIME, 2, DT, column), PM_OK);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        double q = 0.4 + 0.2 * i, p = 0.3 * i - 0.5;
        for (int j = 0; j < NTIME; ++j) {
            double *z = pm_dataset_state(d, i, j);
            z[0] = q;
            z[1] = p;
            for (int k = 0; k < 200; ++k) {
                const double h = DT / 200;
                p -= h / 2 * (q + STIFF * q * q * q);
                q += h * p;
                p -= h / 2 * (q + STIFF * q * q * q);
            }
        }
    }
    assert_int_equal(pm_dataset_save(d, path), PM_OK);
    pm_dataset_free(d);
}

static void write_text(const char *path, const char *text) {
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
}

// The hypotheses: the spring is linear, has a formula that cannot be read, or is cubic; and a
// number that changes nothing. With a context the number comes first.
static pm_status write_training(void *context, const int *chosen, const char *comment,
                                const char *path) {
    static const char *const spring[] = {"k/2*q^2", "k/2*nothing^2", "k/2*q^2 + c/4*q^4"};
    char scene[64], data[64];
    const int first = context != NULL;
    path_of("scene.yaml", scene);
    path_of("data.h5", data);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fprintf(
        file,
        "%sscene: %s\ndata: {file: %s}\nmodels:\n  body:\n"
        "    constants: {k: {learned: 1.0, positive: true}, c: {learned: 1.0, positive: true}}\n"
        "    energy: \"p^2/2 + %s\"\n"
        "    reversible: {given: [[q, p, 1.0]]}\n"
        "subsystems: {body: body}\n"
        "stages:\n"
        "  - {optimiser: gauss_newton, iterations: %d, batch: 512, residual: derivative}\n"
        "  - {optimiser: gauss_newton, iterations: 20, batch: 512}\n",
        comment, scene, data, spring[chosen[first]], 20 + chosen[1 - first]);
    if (start != NULL) {
        fprintf(file, "start: {from: %s}\n", start);
    }
    assert_int_equal(fclose(file), 0);
    return PM_OK;
}

static void read_result(const char *path, char text[TEXT]) {
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    text[fread(text, 1, TEXT - 1, file)] = '\0';
    fclose(file);
}

static void search(double budget, int simplest, char text[TEXT]) {
    static const char *const spring[] = {"linear", "unreadable", "cubic"};
    static const char *const number[] = {"20", "21"};
    pm_hypotheses space = {.write = write_training, .start = &start};
    char path[64];
    path_of("result.yaml", path);
    assert_int_equal(pm_hypotheses_add(&space, "spring", 3, spring), 0);
    assert_int_equal(pm_hypotheses_add(&space, "alone", 1, spring), -1);
    assert_int_equal(pm_hypotheses_add(&space, "number", 2, number), 1);
    space.choice[1].simplest = simplest;
    const pm_search_how how = {.budget = budget};
    assert_int_equal(pm_search_run(&space, &how, path, NULL), PM_OK);
    read_result(path, text);
}

static void the_data_decide(void **state) {
    char text[TEXT], again[TEXT];
    (void)state;
    search(5, 0, text);
    if (strstr(text, "c/4*q^4") == NULL) {
        fail_msg("expected the cubic spring in:\n%s", text);
    }
    assert_non_null(strstr(text, "# * spring: cubic"));
    assert_non_null(strstr(text, "# - spring: unreadable (failed: "));
    search(5, 0, again);
    assert_string_equal(text, again);
    // The simplest of equals goes on, and is compared with what is believed more by longer fits.
    search(5, 1, again);
    assert_non_null(strstr(again, " spring: cubic; number: 21 ("));
    assert_int_equal(strstr(strstr(again, " spring: cubic ("), "; longer: ") != NULL, 1);
    assert_non_null(strstr(again, "start: {from: result.start}"));
    assert_null(start);
    // A fit of the winner starts where its longer fit ended, and the others left nothing.
    static const volatile sig_atomic_t never = 0;
    char path[64], file[64];
    pm_fit fit;
    path_of("result.yaml", path);
    const pm_fit_arguments arguments = {.config = path, .output = folder};
    assert_int_equal(pm_fit_open(&fit, &arguments, &never), PM_OK);
    assert_int_equal(fit.size, 2);
    assert_true(fabs(exp(fit.theta[0] + fit.theta[1]) / STIFF - 1) < 0.05); // k is 1
    pm_fit_close(&fit);
    for (int i = 0; i < 8; ++i) {
        char name[16];
        snprintf(name, sizeof name, "result.start%d", i);
        path_of(name, file);
        assert_int_equal(access(file, F_OK), -1);
    }
    // Weights of another model are refused.
    path_of("result.start", file);
    write_text(file, "no weights");
    assert_int_equal(pm_fit_open(&fit, &arguments, &never), PM_EFILE);
    assert_non_null(strstr(pm_error(), "without the key from of start weights are drawn"));
    pm_fit_close(&fit);
    // A search does not replace a file of somebody else.
    pm_hypotheses space = {.write = write_training, .start = &start};
    assert_int_equal(pm_search_run(&space, &(pm_search_how){.budget = 0}, path, NULL), PM_EFILE);
    assert_int_equal(remove(file), 0);
}

// The choice that changes the group with the largest error is asked first: p follows the force of
// the spring, q does not.
static void the_worst_group_is_asked_about_first(void **state) {
    static const char *const spring[] = {"linear", "unreadable", "cubic"};
    static const char *const number[] = {"20", "21"};
    pm_hypotheses space = {.write = write_training, .context = &space};
    char path[64], text[TEXT];
    (void)state;
    path_of("result.yaml", path);
    pm_hypotheses_add(&space, "number", 2, number);
    pm_hypotheses_add(&space, "spring", 3, spring);
    space.choice[0].acts_on = 1; // q
    space.choice[1].acts_on = 2; // p
    const pm_search_how how = {.budget = 5};
    assert_int_equal(pm_search_run(&space, &how, path, NULL), PM_OK);
    read_result(path, text);
    const char *asked = strstr(text, "# * spring: cubic ("), *later = strstr(text, " number: ");
    if (asked == NULL || (later != NULL && later < asked)) {
        fail_msg("expected the spring first in:\n%s", text);
    }
}

// Writes the cubic spring if both ends are stiffer, and else the linear one.
static pm_status write_ends(void *context, const int *chosen, const char *comment,
                            const char *path) {
    const int spring[2] = {chosen[0] == 1 && chosen[1] == 1 ? 2 : 0, 0};
    return write_training(context, spring, comment, path);
}

// What lowers the error only if it holds for all components is found if they ask the same.
static void what_holds_for_all_is_found(void **state) {
    (void)state;
    static const char *const end[] = {"linear", "stiffer"};
    for (int kind = 0; kind < 2; ++kind) {
        pm_hypotheses space = {.write = write_ends};
        char path[64], text[TEXT];
        path_of("result.yaml", path);
        pm_hypotheses_add(&space, "left", 2, end);
        pm_hypotheses_add(&space, "right", 2, end);
        space.choice[0].kind = space.choice[1].kind = kind;
        const pm_search_how how = {.budget = 5};
        assert_int_equal(pm_search_run(&space, &how, path, NULL), PM_OK);
        read_result(path, text);
        assert_int_equal(strstr(text, "# * left: stiffer; right: stiffer (") != NULL, kind == 1);
    }
}

static void without_a_budget_nothing_is_tried(void **state) {
    char text[TEXT];
    (void)state;
    search(0, 0, text);
    assert_non_null(strstr(text, "\"p^2/2 + k/2*q^2\""));
    assert_null(strstr(text, "#"));
}

// A search that is interrupted writes the best so far, unless its caller asks for the outcome.
static void an_interrupted_search_ends(void **state) {
    static const char *const spring[] = {"linear", "unreadable", "cubic"};
    static const volatile sig_atomic_t stop = 1;
    pm_hypotheses space = {.write = write_training};
    char path[64];
    (void)state;
    path_of("interrupted.yaml", path);
    pm_hypotheses_add(&space, "spring", 3, spring);
    const pm_search_how how = {.budget = 5, .stop = &stop};
    pm_search_outcome outcome;
    char text[TEXT];
    assert_int_equal(pm_search_run(&space, &how, path, &outcome), PM_EINTERRUPTED);
    assert_int_equal(access(path, F_OK), -1);
    assert_int_equal(pm_search_run(&space, &how, path, NULL), PM_EINTERRUPTED);
    read_result(path, text);
    assert_non_null(
        strstr(text, "# * as proposed from units and statistics (failed: interrupted)"));
    assert_null(strstr(text, "cubic"));
    remove(path);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_data_decide),
        cmocka_unit_test(the_worst_group_is_asked_about_first),
        cmocka_unit_test(what_holds_for_all_is_found),
        cmocka_unit_test(without_a_budget_nothing_is_tried),
        cmocka_unit_test(an_interrupted_search_ends),
    };
    char path[64];
    pm_linalg_init();
    if (mkdtemp(folder) == NULL) {
        return 1;
    }
    path_of("scene.yaml", path);
    write_text(path, "scene: spring\ntime: {dt: 0.05, steps: 59, integrator: rk4, substeps: 1}\n"
                     "subsystems:\n  body:\n    weights: body.h5\n    state:\n"
                     "      q: {unit: m, columns: [q]}\n      p: {unit: kg m/s, columns: [p]}\n");
    path_of("data.h5", path);
    write_data(path);
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    static const char *const made[] = {"scene.yaml", "data.h5", "result.yaml", "fit.csv"};
    for (size_t i = 0; i < sizeof made / sizeof *made; ++i) {
        path_of(made[i], path);
        remove(path);
    }
    rmdir(folder);
    return failed;
}
