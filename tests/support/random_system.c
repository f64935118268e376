// Draws models as text, so that a failing model can be read and tried by hand.
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "scene/model_reader.h"

const char random_system_scene[] =
    "scene: random_system\n"
    "time: {dt: 0.02, steps: 20, integrator: rk4, substeps: 1}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {q: {unit: m, size: 2}, p: {unit: kg, size: 2}, s: {unit: J, "
    "size: 1}}}\n"
    "  b: {weights: b.h5, state: {q: {unit: m, size: 2}, p: {unit: kg, size: 2}, s: {unit: J, "
    "size: 1}}}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [a, b], weights: joint.h5, expose: {a: [q, p, s], b: [q, p, "
    "s]}}\n";

const char random_system_part[] =
    "energy:\n"
    "  - {features: [\"|p|^2\", \"<q,p>\"], hidden: [4], skip: linear}\n"
    "  - {features: [\"|q|^2\", s], hidden: [5, 4], skip: quadratic}\n"
    "entropy: [{given: s}, {features: [\"|q|^2\", s], hidden: [3]}]\n"
    "reversible:\n"
    "  given: [[q, p, 1.0]]\n"
    "  learned: {acts_on: [q, p, s], along: [q, p], features: [\"|q|^2\"], hidden: [3]}\n"
    "irreversible:\n"
    "  learned: {acts_on: [p, s], along: [q], features: [\"|p|^2\"], hidden: [3], rank: 2}\n";

const char random_system_port[] =
    "law: bracket\n"
    "reversible:\n"
    "  given: [[a.p, b.q, 1.0]]\n"
    "  learned: {acts_on: [a.p, a.s, b.p, b.s], along: [b.q, a.p], features: [\"<a.q,b.q>\"], "
    "hidden: [3]}\n"
    "irreversible:\n"
    "  learned: {acts_on: [a.s, b.s, b.p], along: [b.q], features: [\"|b.q|^2\", a.s], hidden: "
    "[3]}\n";

// --- text ---

__attribute__((format(printf, 2, 3))) static void add(char *text, const char *format, ...) {
    const size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(text + used, RANDOM_SYSTEM_TEXT - used, format, arguments);
    va_end(arguments);
    if (length < 0 || used + (size_t)length >= RANDOM_SYSTEM_TEXT) {
        abort();
    }
}

static bool toss(pm_rng *rng) {
    return pm_rng_below(rng, 2) == 1;
}

static int between(pm_rng *rng, int low, int high) {
    return low + (int)pm_rng_below(rng, (uint64_t)(high - low + 1));
}

// A list of the first `certain` candidates (or one, if that is 0) and each other with chance one
// half.
static void add_choice(char *text, pm_rng *rng, const char *key, int certain, int count,
                       const char *const *candidate) {
    const int one = between(rng, 0, count - 1);
    add(text, "%s: [", key);
    bool first = true;
    for (int i = 0; i < count; ++i) {
        if (i < certain || (certain == 0 && i == one) || toss(rng)) {
            add(text, "%s\"%s\"", first ? "" : ", ", candidate[i]);
            first = false;
        }
    }
    add(text, "]");
}

// A random quartic skip is left out: half of all such energies have no lower bound, and the states
// run away.
static void add_network(char *text, pm_rng *rng, int certain, int count,
                        const char *const *feature) {
    static const char *const activation[] = {"tanh", "softplus", "silu"};
    static const char *const skip[] = {"none", "linear", "quadratic"};
    add_choice(text, rng, "features", certain, count, feature);
    const bool hidden = toss(rng);
    if (hidden) {
        add(text, toss(rng) ? ", hidden: [4, 3]" : ", hidden: [5]");
    }
    add(text, ", activation: %s, skip: %s", activation[between(rng, 0, 2)],
        skip[between(rng, hidden ? 0 : 1, 2)]);
}

// What an operator may act on and along, and what its network may see.
typedef struct candidates {
    int nacts, nalong, nfeature;
    const char *const *acts_on, *const *along, *const *feature;
    int against;
} candidates;

// A learned operator on the first `certain` groups at least, of which those from `against` on are
// driven by the others (0: all by all). The projection leaves a skew operator
// on two components nothing, nor a positive one on a single component: what such an operator gives
// is rounding, of which no law can be asked. `certain` is chosen to avoid that, and potentials that
// depend on enough.
static void add_learned(char *text, pm_rng *rng, int certain, const candidates *c) {
    add(text, "  learned: {");
    if (c->against > 0) {
        add_choice(text, rng, "acts_on", c->against, c->against, c->acts_on);
        add(text, ", ");
        add_choice(text, rng, "against", c->nacts - c->against, c->nacts - c->against,
                   c->acts_on + c->against);
    } else {
        add_choice(text, rng, "acts_on", certain, c->nacts, c->acts_on);
    }
    if (toss(rng)) {
        add(text, ", ");
        add_choice(text, rng, "along", 0, c->nalong, c->along);
    }
    if (toss(rng)) {
        add(text, ", ");
        add_network(text, rng, 0, c->nfeature, c->feature);
    }
}

static void add_operators(char *text, pm_rng *rng, int size, bool entropy, const candidates *L,
                          const candidates *M) {
    if (size == 1 || toss(rng)) {
        add_learned(text, rng, size == 1 ? L->nacts : 0, L);
        add(text, "}\n");
    }
    if (entropy && between(rng, 0, 3) > 0) {
        add(text, "irreversible:\n");
        add_learned(text, rng, 2, M);
        add(text, ", rank: %d}\n", between(rng, 1, 3));
    }
}

static void add_energy(char *text, pm_rng *rng, int nfeature, const char *const *feature) {
    add(text, "energy:\n");
    if (toss(rng)) {
        add(text, "  - {given: {s: 10.0}}\n");
    }
    for (int i = between(rng, 1, 2); i > 0; --i) {
        add(text, "  - {");
        add_network(text, rng, 2, nfeature, feature);
        add(text, "}\n");
    }
}

static void add_entropy(char *text, pm_rng *rng, int nfeature, const char *const *feature) {
    const int kind = between(rng, 0, 2);
    add(text, "entropy:\n");
    if (kind != 0) {
        add(text, "  - {given: s}\n");
    }
    if (kind != 1) {
        add(text, "  - {");
        add_network(text, rng, 1, nfeature, feature);
        add(text, "}\n");
    }
}

static const char *form_name(pm_form form) {
    return form == PM_HARD ? "hard" : "soft";
}

static void draw_part(char *text, pm_rng *rng, int size, bool entropy, pm_form form) {
    static const char *const feature[] = {"s",     "p",   "q",     "|q|^2", "|p|^2",
                                          "ln|q|", "|q|", "<q,p>", "|p|",   "ln|p|"};
    static const char *const along[] = {"q", "p", "q/|q|", "p/|p|^2"};
    const candidates L = {3, 4, 8, (const char *const[]){"q", "p", "s"}, along, feature, 0};
    const candidates M = {3, 4, 8, (const char *const[]){"p", "s", "q"}, along, feature, 0};
    add(text, "form: %s\n", form_name(form));
    add_energy(text, rng, 10, feature);
    if (entropy) {
        add_entropy(text, rng, 7, feature);
    }
    add(text, "reversible:\n  given: [[q, p, 1.0]]\n");
    add_operators(text, rng, size, entropy, &L, &M);
}

static void draw_port(char *text, pm_rng *rng, int size, pm_form form) {
    static const char *const feature[] = {"a.p",     "b.q",    "a.s",       "b.s",   "|b.q|^2",
                                          "ln|a.p|", "a.dE.s", "<a.p,b.q>", "b.dE.s"};
    static const char *const along[] = {"b.q", "a.p", "b.q/|b.q|", "b.dE.q"};
    const candidates L = {4,
                          4,
                          9,
                          (const char *const[]){"a.p", "a.s", "b.q", "b.s"},
                          along,
                          feature,
                          between(rng, 0, 2)};
    const candidates M = {4,     4,       9, (const char *const[]){"a.s", "b.s", "a.p", "b.q"},
                          along, feature, 0};
    add(text, "law: bracket\nform: %s\nreversible:\n  given: [[a.p, b.q, 1.0]]\n", form_name(form));
    add_operators(text, rng, size, true, &L, &M);
}

static void draw_scene(char *text, pm_rng *rng, int size) {
    add(text, "scene: random_system\n"
              "time: {dt: 0.001, steps: 10, integrator: rk4, substeps: 1}\n"
              "subsystems:\n");
    for (int i = 0; i < 2; ++i) {
        add(text,
            "  %c: {weights: %c.h5, state: {q: {unit: m, size: %d}, p: {unit: kg, size: %d}, s: "
            "{unit: J, size: 1}%s}}\n",
            'a' + i, 'a' + i, size, size, toss(rng) ? ", r: {unit: m, size: 2}" : "");
    }
    add(text,
        "ports:\n"
        "  joint: {law: bracket, between: [a, b], weights: joint.h5, expose: {a: %s, b: %s}}\n",
        toss(rng) ? "[p, s]" : "[s, q, p]", toss(rng) ? "[q, s]" : "[q, p, s]");
}

// --- systems ---

static void require_for(const random_system *w, pm_status status) {
    if (status != PM_OK) {
        random_system_fail(w, "%s", pm_error());
    }
}

// Every number of a component, also those that training fixes from the data.
static void draw_params(pm_params *params, pm_rng *rng) {
    for (int i = 0; i < params->count; ++i) {
        const pm_param_entry *entry = &params->entry[i];
        const char *dot = strrchr(entry->name, '.');
        const bool positive = !entry->trained && (dot == NULL || strcmp(dot, ".mean") != 0);
        for (int j = 0; j < entry->rows * entry->cols; ++j) {
            const double x = pm_rng_normal(rng);
            entry->value[j] = positive ? exp(0.5 * x) : x / sqrt(entry->rows);
        }
    }
}

static void make_part(random_system *w, int i) {
    pm_part *part = w->system->part[i];
    pm_yaml_document *document = NULL;
    pm_yaml block;
    require_for(w, pm_yaml_parse(&document, w->part_text[i % 2], "part", &block));
    require_for(w, pm_part_spec_read(block, (pm_yaml){0}, &w->system->arena, &part->spec));
    require_for(w, pm_part_declare(part));
    pm_yaml_close(document);
    draw_params(&part->params, &w->rng);
}

static void make_port(random_system *w, int i) {
    pm_port_model *port = w->system->port[i];
    pm_yaml_document *document = NULL;
    pm_yaml block;
    require_for(w, pm_yaml_parse(&document, w->port_text, "port", &block));
    require_for(w, pm_port_spec_read(block, (pm_yaml){0}, &w->system->arena, &port->spec));
    require_for(w, pm_port_declare(port));
    pm_yaml_close(document);
    draw_params(&port->params, &w->rng);
}

static void make(random_system *w) {
    pm_linalg_init();
    require_for(w, pm_scene_parse(&w->scene, w->scene_text, "random_system.yaml"));
    require_for(w, pm_system_new(&w->system, w->scene));
    for (int i = 0; i < w->scene->physics.nsubsystem; ++i) {
        make_part(w, i);
    }
    for (int i = 0; i < w->scene->physics.nport; ++i) {
        make_port(w, i);
    }
    w->z = pm_arena_array(&w->scene->arena, (size_t)w->scene->physics.nz, sizeof *w->z);
    for (int i = 0; i < w->scene->physics.nz; ++i) {
        w->z[i] = pm_rng_normal(&w->rng);
    }
}

void random_system_random(random_system *w, uint64_t seed, pm_form form) {
    *w = (random_system){.seed = seed};
    pm_rng_init(&w->rng, seed, 0);
    const int size = between(&w->rng, 1, 3);
    draw_scene(w->scene_text, &w->rng, size);
    draw_part(w->part_text[0], &w->rng, size, true, form);
    draw_part(w->part_text[1], &w->rng, size, toss(&w->rng), form);
    draw_port(w->port_text, &w->rng, size, form);
    make(w);
}

void random_system_of_text(random_system *w, uint64_t seed, const char *scene, const char *part,
                           const char *port) {
    *w = (random_system){.seed = seed};
    pm_rng_init(&w->rng, seed, 0);
    add(w->scene_text, "%s", scene);
    add(w->part_text[0], "%s", part);
    add(w->part_text[1], "%s", part);
    add(w->port_text, "%s", port == NULL ? "" : port);
    make(w);
}

void random_system_close(random_system *w) {
    pm_system_free(w->system);
    pm_scene_free(w->scene);
    *w = (random_system){0};
}

// --- messages ---

void random_system_fail(const random_system *w, const char *format, ...) {
    char message[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    print_error("%s\nparts:\n%s\n%s\nport:\n%s\n", w->scene_text, w->part_text[0], w->part_text[1],
                w->port_text);
    fail_msg("seed %llu: %s", (unsigned long long)w->seed, message);
}

void random_system_check(const random_system *w, const char *what, double value, double expected,
                         double tolerance) {
    if (!(fabs(value - expected) <= tolerance)) {
        random_system_fail(w, "%s: %.17g, expected %.17g within %g", what, value, expected,
                           tolerance);
    }
}
