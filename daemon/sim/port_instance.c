// One end of a port: the graph of its law, evaluated stage by stage.
#include "sim/port_instance.h"

#include <assert.h>
#include <string.h>

#include "model/prediction.h"
#include "sim/flux.h"
#include "sim/program_input.h"

static double value_at(const double *covector, int i) {
    return covector == NULL ? 0 : covector[i];
}

// --- opening ---

static pm_status open_end(pm_port_instance_end *end, pm_arena *arena, const pm_scene_port *port,
                          int ny, bool discrete) {
    double *memory = pm_arena_array(arena, 4 * (size_t)ny, sizeof *memory);
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for port %s", port->name);
    }
    *end = (pm_port_instance_end){.ny = ny,
                                  .y = memory,
                                  .e = memory + ny,
                                  .eta = memory + 2 * (ptrdiff_t)ny,
                                  .response = memory + 3 * (ptrdiff_t)ny};
    end->shown = (pm_port_values){ny, end->y, end->e, end->eta, discrete ? end->response : NULL, 0};
    return PM_OK;
}

static double *value_of(pm_program *program, pm_node x) {
    return x == PM_NO_NODE ? NULL : pm_program_value(program, x);
}

// The nodes of the law's graph: its inputs, the irreversible rates of the prediction, and at one or
// both ends the rate and the co-energy at which the law is evaluated.
typedef struct law_graph {
    pm_port_nodes input[2];
    pm_node last, next;
    pm_node rate[2], e[2];
} law_graph;

// Builds the rate at `end`. Index 0 of rate and e is the subsystem's end, index 1 the other one.
static void build_rate(pm_graph *g, const pm_port_model *model, law_graph *law, int index,
                       pm_end end) {
    pm_port_nodes ends[2] = {law->input[0], law->input[1]};
    pm_node degeneracy = PM_NO_NODE;
    law->rate[index] = pm_port_rate(g, model, end, ends, law->last, &law->next, &degeneracy);
    law->e[index] = ends[end].e == law->input[end].e ? PM_NO_NODE : ends[end].e;
}

static void build_law(pm_graph *g, const pm_system *system, const pm_port_instance *j,
                      bool discrete, law_graph *law) {
    const pm_port_model *model = system->port[j->port_id];
    for (int i = 0; i < 2; ++i) {
        const int ny = model->layout[i].nz;
        const bool entropy = pm_system_end_has_entropy(system, j->port_id, i);
        // A boundary input is prescribed: its co-energy does not respond to the rate.
        const bool responds = discrete && (j->boundary_input == NULL || i == (int)j->end);
        law->input[i] = (pm_port_nodes){pm_input(g, true, 1, ny), pm_input(g, true, 1, ny),
                                        entropy ? pm_input(g, true, 1, ny) : PM_NO_NODE,
                                        responds ? pm_input(g, true, 1, ny) : PM_NO_NODE};
    }
    law->last = pm_input(g, true, 1, j->nboth);
    law->rate[1] = law->e[1] = PM_NO_NODE;
    build_rate(g, model, law, 0, j->end);
    if (j->boundary_input != NULL || j->shared) {
        build_rate(g, model, law, 1, j->end == PM_END_A ? PM_END_B : PM_END_A);
    }
}

static pm_status open_program(pm_port_instance *j, const pm_graph *g, const law_graph *law) {
    const pm_node wanted[] = {law->rate[0], law->e[0], law->rate[1], law->e[1], law->next};
    pm_node output[5];
    int count = 0;
    for (int i = 0; i < 5; ++i) {
        if (wanted[i] != PM_NO_NODE) {
            output[count++] = wanted[i];
        }
    }
    PM_TRY(pm_program_open(&j->program, g, count, output, 1));
    for (int i = 0; i < 2; ++i) {
        const pm_port_nodes *n = &law->input[i];
        j->input[i] = (pm_port_instance_end){.ny = pm_graph_shape(g, n->y).cols,
                                             .y = pm_input_of(j->program, n->y),
                                             .e = pm_input_of(j->program, n->e),
                                             .eta = pm_input_of(j->program, n->eta),
                                             .response = pm_input_of(j->program, n->response)};
        j->rate[i] = value_of(j->program, law->rate[i]);
        j->law_e[i] = value_of(j->program, law->e[i]);
    }
    j->next = value_of(j->program, law->next);
    j->last = law->next == PM_NO_NODE ? NULL : value_of(j->program, law->last);
    return PM_OK;
}

static pm_status open_law(pm_port_instance *j, const pm_system *system, bool discrete) {
    pm_graph *g = NULL;
    PM_TRY(pm_graph_open(&g));
    law_graph law;
    build_law(g, system, j, discrete, &law);
    const pm_status status = law.rate[0] == PM_NO_NODE ? PM_OK : open_program(j, g, &law);
    pm_graph_close(g);
    return status;
}

pm_status pm_port_instance_open(pm_port_instance *j, pm_arena *arena, const pm_system *system,
                                const pm_integrator *integrator, int port_id, pm_end end) {
    const pm_scene_port *port = &system->scene->port[port_id];
    const int other = 1 - (int)end;
    *j = (pm_port_instance){.port_id = port_id,
                            .end = end,
                            .component = port->component[end],
                            .contact = strcmp(port->law, "contact") == 0,
                            .outside_component = port->component[other],
                            .nboth = port->layout[0].nz + port->layout[1].nz};
    PM_TRY(open_end(&j->own, arena, port, port->layout[end].nz, integrator->discrete));
    if (port->boundary_input[other] >= 0) {
        j->boundary_input = &system->scene->boundary_input[port->boundary_input[other]];
    }
    if (j->boundary_input != NULL || j->contact) {
        PM_TRY(open_end(&j->outside, arena, port, port->layout[other].nz,
                        integrator->discrete && j->boundary_input == NULL));
    }
    return open_law(j, system, integrator->discrete);
}

pm_status pm_port_instance_share(pm_port_instance *here, pm_port_instance *there,
                                 const pm_system *system, const pm_integrator *integrator) {
    if (system->port[here->port_id]->law->separate || here->program == NULL ||
        there->program == NULL) {
        return PM_OK;
    }
    pm_port_instance_close(here);
    pm_port_instance_close(there);
    there->peer = here;
    here->shared = true;
    return open_law(here, system, integrator->discrete);
}

void pm_port_instance_close(pm_port_instance *j) {
    pm_program_close(j->program);
    j->program = NULL;
}

// --- one round ---

void pm_port_instance_expose(pm_port_instance *j, const double *z, const double *dE,
                             const double *dS, const double *response) {
    for (int c = 0; c < j->own.ny; ++c) {
        const int at = j->component[c];
        j->own.y[c] = z[at];
        j->own.e[c] = value_at(dE, at);
        j->own.eta[c] = value_at(dS, at);
        j->own.response[c] = value_at(response, at);
    }
}

const pm_port_values *pm_port_instance_prescribe(pm_port_instance *j, const double *prescribed) {
    const double *value = prescribed + j->boundary_input->first;
    const int nz = j->boundary_input->layout.nz;
    for (int c = 0; c < j->outside.ny; ++c) {
        const int at = j->outside_component[c];
        j->outside.y[c] = value[at];
        j->outside.e[c] = value[nz + at];
        j->outside.eta[c] = value[2 * nz + at];
    }
    return &j->outside.shown;
}

const pm_port_values *pm_port_instance_end_values(pm_port_instance *j,
                                                  const pm_port_values *other) {
    if (!j->contact || other->response == NULL) {
        return other;
    }
    for (int c = 0; c < other->ny; ++c) {
        j->outside.y[c] = other->y[c];
        j->outside.e[c] = other->response[c];
        j->outside.eta[c] = other->eta[c];
        j->outside.response[c] = other->response[c];
    }
    return &j->outside.shown;
}

// Sets the rate from which the prediction starts: zero in the first stage of a substep, and the
// result of the stage before in later ones. Returns true if a bit changed.
static bool renew_last(pm_port_instance *j, bool first) {
    if (!first) {
        return pm_renew(j->last, j->next, j->nboth);
    }
    bool renewed = false;
    for (int i = 0; i < j->nboth && j->last != NULL; ++i) {
        renewed = renewed || j->last[i] != 0;
        j->last[i] = 0;
    }
    return renewed;
}

// Copies the values of both ends to the inputs of the law. Returns true if a bit changed.
static bool renew_inputs(pm_port_instance *j, const pm_port_values *other, bool first) {
    bool renewed = renew_last(j, first);
    for (int i = 0; i < 2; ++i) {
        const pm_port_values *shown = i == (int)j->end ? &j->own.shown : other;
        const pm_port_instance_end *to = &j->input[i];
        assert(shown->ny == to->ny);
        renewed |= pm_renew(to->y, shown->y, to->ny);
        renewed |= pm_renew(to->e, shown->e, to->ny);
        renewed |= pm_renew(to->eta, shown->eta, to->ny);
        renewed |= pm_renew(to->response, shown->response, to->ny);
    }
    return renewed;
}

static void evaluate(pm_port_instance *j, const pm_port_values *other, bool first) {
    j->renewed = renew_inputs(j, other, first) || !j->known;
    if (!j->known) {
        pm_program_prepare(j->program);
    }
    if (j->renewed) {
        pm_program_run_prepared(j->program, 1);
        j->known = true;
    }
}

static void book(pm_flux *flux, double weight, const pm_port_instance_end *end, const double *law_e,
                 const double *rate) {
    pm_flux_book(flux, weight, end->ny, law_e != NULL ? law_e : end->e, end->eta, rate);
}

bool pm_port_instance_couple(pm_port_instance *j, const pm_port_values *other, bool first,
                             double weight, double *k) {
    const pm_port_instance *law = j->peer != NULL ? j->peer : j;
    const int index = j->peer != NULL ? 1 : 0;
    if (law->program == NULL) {
        return false;
    }
    if (j->peer == NULL) {
        evaluate(j, other, first);
    }
    for (int c = 0; c < j->own.ny; ++c) {
        k[j->component[c]] += law->rate[index][c];
    }
    book(&j->booking, weight, &j->own, law->law_e[index], law->rate[index]);
    if (j->boundary_input != NULL && j->rate[1] != NULL) {
        book(&j->outside_booking, weight, &j->outside, j->law_e[1], j->rate[1]);
    }
    return law->renewed;
}

// --- checkpoint ---

void pm_port_instance_record(pm_port_instance *j, pm_record *record) {
    if (j->program == NULL) {
        return;
    }
    pm_record_put_bool(record, "known", &j->known);
    for (int i = 0; i < 2; ++i) {
        const pm_port_instance_end *end = &j->input[i];
        pm_record_put(record, "y", end->y, end->ny);
        pm_record_put(record, "e", end->e, end->ny);
        pm_record_put(record, "eta", end->eta, end->ny);
        pm_record_put(record, "response", end->response, end->ny);
    }
    pm_record_put(record, "last", j->last, j->nboth);
    if (pm_record_restores(record) && j->known) {
        pm_program_run(j->program, 1);
    }
}
