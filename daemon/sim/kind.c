// The kinds of subsystems. A graph evaluates E, S and the bulk term L dE + M dS (README.md,
// equation (1)); a graph with contact skips the evaluation while no pair of points can touch
// (contact_broadphase.h); a solid balances forces (solid_dynamics.h); a gap beside a solid searches
// for forces with which its bodies agree (contact_gap.h).
#include <math.h>
#include <string.h>

#include "model/prediction.h"
#include "sim/contact_broadphase.h"
#include "sim/contact_gap.h"
#include "sim/engine.h"
#include "sim/solid_dynamics.h"

// --- what all kinds share ---

// Shows `value` [nz][width] in a block; NULL: nothing has changed. Notes what has changed.
static void show(const pm_data *d, const pm_subsystem_group *group, int block, pm_shown what,
                 const double *value) {
    const int size = group->nz * group->width;
    uint64_t *changed = d->changed[what] + group->first_lane + (ptrdiff_t)block * group->width;
    if (value == NULL) {
        memset(changed, 0, (size_t)group->width * sizeof *changed);
    } else {
        pm_lanes_renew(group->nz, group->width, value,
                       d->shown[what] + group->first + (ptrdiff_t)block * size, changed);
    }
}

// Counts the lanes of which nothing has changed.
static void count_resting(int lanes, const uint64_t *changed, long *rested) {
    if (pm_lanes_all(lanes, changed)) {
        return;
    }
    for (int l = 0; l < lanes; ++l) {
        rested[l] += changed[l] == 0;
    }
}

// Books the heat of a solid or of a gap, which take their steps in `iterate`.
static void book_heat(const pm_data *d, const pm_subsystem_group *group, double weight, int entropy,
                      double temperature) {
    const int64_t at = group->first + entropy, lane = group->first_lane;
    if (pm_is_first_round(d)) {
        d->bulk.energy[lane] = d->bulk.entropy[lane] = 0;
        d->bulk.energy_gross[lane] = d->bulk.entropy_gross[lane] = 0;
    }
    if (weight == 0) {
        return;
    }
    const double production = weight * (d->stage_z[at] - d->z[at]) / d->h;
    d->bulk.entropy[lane] += production;
    d->bulk.entropy_gross[lane] += production;
    d->bulk.energy_gross[lane] += temperature * production;
}

// --- the graphs of a group ---

static pm_status open_exposure(const pm_model *m, pm_subsystem_group *group, pm_graph *g, int width,
                               bool discrete, int *ports) {
    const pm_part *part = group->part;
    const pm_node z = pm_input(g, true, 1, group->nz);
    const pm_node from = discrete ? pm_input(g, true, 1, group->nz) : PM_NO_NODE;
    enum { E, S, DE, DS, RESPONSE, COUNT };
    pm_node node[COUNT] = {pm_part_energy(g, part, z), pm_part_entropy(g, part, z), PM_NO_NODE,
                           PM_NO_NODE, PM_NO_NODE};
    pm_part_coenergies(g, part, from, z, &node[DE], &node[DS]);
    if (discrete) {
        pm_system_responding(m->system, group->id[0], ports);
        const pm_node response = pm_part_response(g, part, node[DE], z, ports);
        const pm_physics *physics = &m->system->scene->physics;
        node[RESPONSE] = response == PM_NO_NODE
                             ? PM_NO_NODE
                             : pm_scale(g, response, physics->dt / physics->substeps);
    }
    const double **const value[COUNT] = {&group->E, &group->S, &group->shown[PM_SHOWN_DE],
                                         &group->shown[PM_SHOWN_DS],
                                         &group->shown[PM_SHOWN_RESPONSE]};
    pm_node output[COUNT];
    int count = 0;
    for (int i = 0; i < COUNT; ++i) {
        if (node[i] != PM_NO_NODE) {
            output[count++] =
                pm_broadcast_to(g, node[i], (pm_shape){true, 1, pm_graph_shape(g, node[i]).cols});
        }
    }
    PM_TRY(pm_program_open_lanes(&group->exposure, g, count, output, width));
    if (group->exposure != NULL) {
        group->z = pm_program_value(group->exposure, z);
        group->from = from == PM_NO_NODE ? NULL : pm_program_value(group->exposure, from);
        count = 0;
        for (int i = 0; i < COUNT; ++i) {
            *value[i] =
                node[i] == PM_NO_NODE ? NULL : pm_program_value(group->exposure, output[count++]);
        }
    }
    return PM_OK;
}

// Sets *served to false if the bulk term exists, but cannot be run in `width` lanes.
static pm_status open_bulk(pm_subsystem_group *group, pm_graph *g, int width, bool *served) {
    const pm_node input[] = {pm_input(g, true, 1, group->nz), pm_input(g, true, 1, group->nz),
                             group->shown[PM_SHOWN_DS] == NULL ? PM_NO_NODE
                                                               : pm_input(g, true, 1, group->nz)};
    pm_node degeneracy = PM_NO_NODE;
    pm_node rate = pm_part_bulk(g, group->part, input[PM_SHOWN_Z], input[PM_SHOWN_DE],
                                input[PM_SHOWN_DS], &degeneracy);
    if (rate == PM_NO_NODE) {
        return PM_OK;
    }
    rate = pm_broadcast_to(g, rate, (pm_shape){true, 1, group->nz});
    PM_TRY(pm_program_open_lanes(&group->bulk, g, 1, &rate, width));
    *served = group->bulk != NULL;
    for (int i = 0; i < 3 && *served; ++i) {
        group->bulk_input[i] = pm_program_input(group->bulk, input[i]);
        group->bulk_rate = pm_program_value(group->bulk, rate);
    }
    return PM_OK;
}

// Opens the graphs of a group with `width` lanes, with discrete derivatives if `discrete` is true.
// Leaves group->exposure NULL if they cannot be run in these lanes. PM_ENOMEM.
static pm_status open_graphs(const pm_model *m, pm_subsystem_group *group, int width,
                             bool discrete) {
    pm_arena scratch = {0};
    pm_graph *exposure = NULL, *bulk = NULL, *release = NULL;
    bool served = true;
    pm_status status;
    int *ports = pm_arena_array(&scratch, (size_t)group->nz, sizeof *ports);
    PM_TRY_DONE(pm_arena_status(&scratch, "the graphs of a subsystem"));
    PM_TRY_DONE(pm_graph_open(&exposure));
    PM_TRY_DONE(pm_graph_open(&bulk));
    PM_TRY_DONE(pm_graph_open(&release));
    PM_TRY_DONE(open_exposure(m, group, exposure, width, discrete, ports));
    if (group->exposure != NULL) {
        PM_TRY_DONE(open_bulk(group, bulk, width, &served));
    }
    if (group->exposure != NULL && served && pm_part_has_coenergies(group->part)) {
        const pm_node z = pm_input(release, true, 1, group->nz);
        const pm_node rate = pm_input(release, true, 1, group->nz);
        const pm_node released = pm_part_release(release, group->part, z, rate);
        if (released != rate) {
            PM_TRY_DONE(pm_program_open_lanes(&group->release, release, 1, &released, width));
            served = group->release != NULL;
        }
        if (group->release != NULL) {
            group->release_z = pm_program_value(group->release, z);
            group->release_rate = pm_program_value(group->release, rate);
            group->released = pm_program_value(group->release, released);
        }
    }
    if (!served) {
        pm_program_close(group->exposure);
        group->exposure = NULL;
    }
    if (group->exposure != NULL) {
        PM_TRY_DONE(pm_compiler_add(m->compiler, group->exposure, exposure));
        PM_TRY_DONE(pm_compiler_add(m->compiler, group->bulk, bulk));
        PM_TRY_DONE(pm_compiler_add(m->compiler, group->release, release));
    }
done:
    pm_graph_close(exposure);
    pm_graph_close(bulk);
    pm_graph_close(release);
    pm_arena_free(&scratch);
    return status;
}

// --- graph ---

static pm_status open_graph(pm_model *m, pm_subsystem_group *group, int width) {
    PM_TRY(open_graphs(m, group, width, m->method->implicit));
    group->width = group->exposure != NULL ? width : 0;
    return PM_OK;
}

static void close_graph(pm_subsystem_group *group) {
    pm_program_close(group->exposure);
    pm_program_close(group->bulk);
    pm_program_close(group->release);
    group->exposure = group->bulk = group->release = NULL;
}

static bool is_any(const pm_model *m, int id) {
    (void)m;
    (void)id;
    return true;
}

// Returns true if z, and `from` unless it is NULL, lie in the box around the last evaluated state.
static bool is_bounded(const pm_contact_broadphase *box, const pm_subsystem_group *group,
                       const double *z, const double *from) {
    return pm_contact_broadphase_holds(box, group->z, z) &&
           (from == NULL || pm_contact_broadphase_holds(box, group->z, from));
}

// Decides whether the exposure of a group of one must be evaluated, and sets its inputs.
static bool renew_single(const pm_model *m, const pm_data *d, const pm_subsystem_group *group,
                         bool ends_step) {
    pm_contact_broadphase *box = group->object;
    const double *z = d->stage_z + group->first;
    const double *from = group->from == NULL ? NULL : d->z + group->first;
    bool *known = &d->known[group->first_block];
    if (box != NULL && ends_step) {
        pm_contact_broadphase_forget(box);
    }
    if (box != NULL && *known && is_bounded(box, group, z, from)) {
        return false;
    }
    bool changed = !*known;
    changed |= pm_renew(group->z, z, group->nz);
    changed |= pm_renew(group->from, from, group->nz);
    if (changed) {
        pm_program_run_prepared(group->exposure, 1);
        *known = true;
    }
    if (box != NULL && (changed || ends_step)) {
        pm_contact_broadphase_enclose(box, group->z, group->shown[PM_SHOWN_DE],
                                      ends_step ? NULL : pm_stage_rates(m, d) + group->first);
        // Discrete gradients depend on two states: the box is kept only if it contains both.
        box->enclosed = is_bounded(box, group, group->z, group->from);
    }
    return changed;
}

static void expose_graph(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                         bool ends_step) {
    const int width = group->width, size = group->nz * width;
    const int64_t lane = group->first_lane + (int64_t)block * width;
    bool changed;
    if (m->method->implicit || group->object != NULL) {
        changed = renew_single(m, d, group, ends_step);
        d->rested[lane] += !changed;
    } else {
        const uint64_t *z = d->changed[PM_SHOWN_Z] + lane;
        changed = pm_lanes_any(width, z);
        count_resting(width, z, d->rested + lane);
        if (changed) {
            memcpy(group->z, d->stage_z + group->first + (ptrdiff_t)block * size,
                   (size_t)size * sizeof *group->z);
            pm_program_run_prepared(group->exposure, width);
        }
    }
    for (int i = PM_SHOWN_DE; i < PM_SHOWN_COUNT && d->shown[i] != NULL; ++i) {
        const double *value = changed ? group->shown[i] : NULL;
        if (i == PM_SHOWN_RESPONSE && value != NULL &&
            d->halvings > 0) { // the graph is for a substep
            for (int c = 0; c < size; ++c) {
                d->scratch[c] = ldexp(value[c], -d->halvings);
            }
            value = d->scratch;
        }
        show(d, group, block, (pm_shown)i, value);
    }
    if (changed) {
        memcpy(d->E + lane, group->E, (size_t)width * sizeof *d->E);
        if (group->S != NULL) {
            memcpy(d->S + lane, group->S, (size_t)width * sizeof *d->S);
        }
    }
}

static void bulk_graph(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                       double weight, double *k) {
    (void)m;
    const int width = group->width, size = group->nz * width;
    const int64_t first = group->first + (int64_t)block * size;
    const int64_t lane = group->first_lane + (int64_t)block * width;
    if (group->bulk == NULL) {
        memset(k, 0, (size_t)size * sizeof *k);
        return;
    }
    uint64_t changed[PM_MOST_LANES];
    memset(changed, 0, (size_t)width * sizeof *changed);
    for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
        for (int l = 0; l < width && group->bulk_input[i] != NULL; ++l) {
            changed[l] |= d->changed[i][lane + l];
        }
    }
    const bool any = pm_lanes_any(width, changed);
    // The only block of a group finds its last rates in the program. Blocks of one subsystem keep
    // them; others do so from the first time on at which they rest.
    const bool alone = group->nblock == 1, keeps = !alone && (!any || width == 1);
    bool *kept = &d->bulk_kept[group->first_block + block];
    const double *rate = keeps ? d->bulk_rate + first : group->bulk_rate;
    count_resting(width, changed, d->rested + lane);
    if (any || !*kept) {
        for (int i = 0; i < PM_SHOWN_COUNT; ++i) {
            if (group->bulk_input[i] != NULL) {
                memcpy(group->bulk_input[i], d->shown[i] + first, (size_t)size * sizeof *k);
            }
        }
        pm_program_run_prepared(group->bulk, width);
        if (keeps) {
            memcpy(d->bulk_rate + first, group->bulk_rate, (size_t)size * sizeof *k);
        }
    }
    memcpy(k, rate, (size_t)size * sizeof *k);
    *kept = keeps || alone;
    const pm_lane_flux flux = pm_lane_flux_from(&d->bulk, lane);
    const bool begins = pm_is_first_round(d);
    if (begins || weight != 0) {
        pm_lanes_book(group->nz, width, weight, begins, d->shown[PM_SHOWN_DE] + first,
                      group->shown[PM_SHOWN_DS] == NULL ? NULL : d->shown[PM_SHOWN_DS] + first, k,
                      &flux);
    }
    const int left = group->count - block * width; // lanes without a subsystem stay where they are
    for (int c = 0; c < group->nz && left < width; ++c) {
        memset(k + (ptrdiff_t)c * width + left, 0, (size_t)(width - left) * sizeof *k);
    }
}

static bool iterate_graph(const pm_model *m, pm_data *d, const pm_subsystem_group *group,
                          double *next) {
    const double *z = d->z + group->first, *k = pm_stage_rates(m, d) + group->first;
    for (int c = 0; c < group->nz; ++c) {
        next[c] = z[c] + d->h * k[c];
    }
    return true;
}

// --- graph with contact ---

static bool has_contact(const pm_model *m, int id) {
    pm_arena arena = {0};
    pm_contact_broadphase b = {0};
    const bool has = pm_contact_broadphase_open(&b, &arena, m->system->part[id]) != PM_OK ||
                     b.unconstrained != NULL;
    pm_contact_broadphase_close(&b);
    pm_arena_free(&arena);
    return has;
}

static pm_status open_contact(pm_model *m, pm_subsystem_group *group, int width) {
    PM_TRY(open_graph(m, group, width));
    group->object = pm_arena_alloc(&m->arena, sizeof(pm_contact_broadphase));
    PM_TRY(pm_arena_status(&m->arena, "pairs of points"));
    return pm_contact_broadphase_open(group->object, &m->arena, group->part);
}

static void close_contact(pm_subsystem_group *group) {
    if (group->object != NULL) {
        pm_contact_broadphase_close(group->object);
    }
    close_graph(group);
}

// --- solid ---

static bool is_solid(const pm_model *m, int id) {
    return pm_part_kind_of(m->system->part[id]) == PM_PART_SOLID;
}

static pm_status open_solid(pm_model *m, pm_subsystem_group *group, int width) {
    group->width = width;
    group->object = pm_arena_alloc(&m->arena, sizeof(pm_solid_dynamics));
    PM_TRY(pm_arena_status(&m->arena, "a solid"));
    return pm_solid_dynamics_open(group->object, &m->arena, group->part,
                                  m->system->mesh[group->id[0]]);
}

static void close_solid(pm_subsystem_group *group) {
    if (group->object != NULL) {
        pm_solid_dynamics_close(group->object);
    }
}

static void start_solid(const pm_data *d, const pm_subsystem_group *group, bool run) {
    (void)run;
    pm_solid_dynamics_start(group->object, d->z + group->first);
}

static void expose_solid(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                         bool ends_step) {
    (void)m;
    (void)ends_step;
    pm_solid_dynamics *solid = group->object;
    pm_solid_dynamics_expose(solid, d->stage_z + group->first, d->z + group->first, d->h);
    d->E[group->first_lane] = solid->E;
    d->S[group->first_lane] = solid->S;
    show(d, group, block, PM_SHOWN_DE, solid->dE);
    show(d, group, block, PM_SHOWN_DS, solid->dS);
}

static void bulk_solid(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                       double weight, double *k) {
    (void)m;
    (void)block;
    const pm_solid_dynamics *solid = group->object;
    memset(k, 0, (size_t)group->nz * sizeof *k);
    memset(d->end_k + group->first, 0, (size_t)group->nz * sizeof *k);
    book_heat(d, group, weight, solid->s, solid->temperature);
}

static bool iterate_solid(const pm_model *m, pm_data *d, const pm_subsystem_group *group,
                          double *next) {
    pm_solid_dynamics *solid = group->object;
    const size_t size = (size_t)group->nz * sizeof *next;
    memcpy(solid->end_rate, d->end_k + group->first, size);
    pm_solid_dynamics_balance(solid, d->h, d->z + group->first,
                              pm_stage_rates(m, d) + group->first);
    if (d->stage > 0 && !solid->changed) { // as in every second round in contact
        return false;
    }
    memcpy(next, solid->result, size);
    return true;
}

static void end_substep_solid(const pm_data *d, const pm_subsystem_group *group) {
    (void)d;
    pm_solid_dynamics_end_substep(group->object);
}

static pm_status check_solid(const pm_model *m, const pm_subsystem_group *group, long step) {
    const pm_solid_dynamics *solid = group->object;
    return solid->status == PM_OK
               ? PM_OK
               : pm_fail(solid->status,
                         "subsystem %s: step %ld: no balance of forces, not even in short steps: "
                         "the load is too large, or an element is turned inside out",
                         m->system->scene->physics.subsystem[group->id[0]].name, step);
}

static void serialize_solid(const pm_subsystem_group *group, pm_serializer *serializer) {
    pm_solid_dynamics_record(group->object, serializer);
}

// --- gap ---

// Returns true if a subsystem is the second end of a port of the law `contact` whose first end is a
// solid.
static bool is_gap(const pm_model *m, int id) {
    const pm_physics *physics = &m->system->scene->physics;
    for (int i = 0; i < physics->nport && m->method->implicit; ++i) {
        const int body = physics->port[i].subsystem[PM_END_A];
        if (physics->port[i].subsystem[PM_END_B] == id && body >= 0 &&
            strcmp(physics->port[i].law, "contact") == 0 &&
            pm_part_kind_of(m->system->part[body]) == PM_PART_SOLID) {
            return true;
        }
    }
    return false;
}

static pm_status open_gap(pm_model *m, pm_subsystem_group *group, int width) {
    group->width = width;
    group->object = pm_arena_alloc(&m->arena, sizeof(pm_contact_gap));
    PM_TRY(pm_arena_status(&m->arena, "a gap"));
    PM_TRY(pm_contact_gap_open(group->object, &m->arena, m->system, group->id[0]));
    PM_TRY(open_graphs(m, group, width, false));
    pm_contact_gap_set_program(group->object, group->exposure, group->z, group->E,
                               group->shown[PM_SHOWN_DE]);
    return PM_OK;
}

static void start_gap(const pm_data *d, const pm_subsystem_group *group, bool run) {
    pm_contact_gap *gap = group->object;
    // A run does not depend on what a run before it has learned of the bodies.
    gap->count = run ? 0 : gap->count;
    pm_contact_gap_begin(gap, d->z + group->first);
}

static void expose_gap(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                       bool ends_step) {
    (void)m;
    (void)ends_step;
    pm_contact_gap *gap = group->object;
    pm_contact_gap_expose(gap, d->stage_z + group->first);
    d->E[group->first_lane] = gap->E;
    d->S[group->first_lane] = gap->S;
    show(d, group, block, PM_SHOWN_DE, gap->dE);
    show(d, group, block, PM_SHOWN_DS, gap->dS);
    show(d, group, block, PM_SHOWN_RESPONSE, gap->response);
}

static void bulk_gap(const pm_model *m, pm_data *d, const pm_subsystem_group *group, int block,
                     double weight, double *k) {
    (void)m;
    (void)block;
    const pm_contact_gap *gap = group->object;
    memset(k, 0, (size_t)group->nz * sizeof *k);
    book_heat(d, group, weight, gap->s, gap->temperature);
}

static bool iterate_gap(const pm_model *m, pm_data *d, const pm_subsystem_group *group,
                        double *next) {
    double *reached = d->scratch + 3 * (ptrdiff_t)m->most_nz;
    iterate_graph(m, d, group, reached);
    pm_contact_gap_next(group->object, d->stage_z + group->first, reached, next);
    return true;
}

static double change_gap(const pm_subsystem_group *group, double change) {
    return pm_contact_gap_change(group->object, change);
}

static void end_substep_gap(const pm_data *d, const pm_subsystem_group *group) {
    pm_contact_gap_begin(group->object, d->z + group->first);
}

static void serialize_gap(const pm_subsystem_group *group, pm_serializer *serializer) {
    pm_contact_gap_record(group->object, serializer);
}

// --- the table ---

// A subsystem has the first of these kinds whose `is` accepts it.
static const pm_kind kinds[] = {
    {.name = "solid",
     .single = true,
     .needs_end_rates = true,
     .is = is_solid,
     .open = open_solid,
     .close = close_solid,
     .start = start_solid,
     .expose = expose_solid,
     .bulk = bulk_solid,
     .iterate = iterate_solid,
     .end_substep = end_substep_solid,
     .check = check_solid,
     .serialize = serialize_solid},
    {.name = "gap",
     .single = true,
     .keeps_energy = true,
     .is = is_gap,
     .open = open_gap,
     .close = close_graph,
     .start = start_gap,
     .expose = expose_gap,
     .bulk = bulk_gap,
     .iterate = iterate_gap,
     .change = change_gap,
     .end_substep = end_substep_gap,
     .serialize = serialize_gap},
    {.name = "graph with contact",
     .single = true,
     .is = has_contact,
     .open = open_contact,
     .close = close_contact,
     .expose = expose_graph,
     .bulk = bulk_graph,
     .iterate = iterate_graph},
    {.name = "graph",
     .keeps_energy = true,
     .is = is_any,
     .open = open_graph,
     .close = close_graph,
     .expose = expose_graph,
     .bulk = bulk_graph,
     .iterate = iterate_graph},
};

const pm_kind *pm_kind_of(const pm_model *m, int id) {
    const pm_kind *kind = kinds;
    while (!kind->is(m, id)) {
        ++kind;
    }
    return kind;
}
