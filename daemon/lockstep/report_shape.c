// Lists what the reports of a process hold, and allocates their messages.
#include "lockstep/report_shape.h"

#include "lockstep/lookahead.h"

#define LARGEST_REPORT 32768 // bytes of numbers in a report of several steps; avoids fragments

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "reports: out of memory");
}

// Adds the ends of a subsystem to the shape.
static void add_ends(pm_report_shape *shape, const pm_scene *scene, int id) {
    const int first = shape->nend;
    for (int k = scene->first_end[id]; k < scene->first_end[id + 1]; ++k) {
        shape->end[shape->nend++] = scene->end_at[k];
    }
    for (int k = first, last = shape->nend; k < last; ++k) {
        const int other = shape->end[k] ^ 1;
        if (scene->port[other / 2].boundary_input[other % 2] >= 0) {
            shape->end[shape->nend++] = other;
        }
    }
}

// Lists the subsystems of a shape, and takes room for their ends.
static pm_status list_parts(pm_report_shape *shape, pm_arena *arena, const pm_scene *scene,
                            const pm_scene_process *process, bool sums) {
    size_t nend = 0;
    shape->part = pm_arena_array(arena, (size_t)process->count, sizeof *shape->part);
    if (shape->part == NULL) {
        return no_memory();
    }
    for (int i = 0; i < process->count; ++i) {
        const int id = process->subsystem[i];
        if (!sums || pm_scene_lists_subsystem(scene, id)) {
            shape->part[shape->npart++] = i;
            nend += 2 * (size_t)(scene->first_end[id + 1] - scene->first_end[id]);
        }
    }
    shape->end = pm_arena_array(arena, nend, sizeof *shape->end);
    return shape->end == NULL ? no_memory() : PM_OK;
}

static pm_status init(pm_report_shape *shape, pm_arena *arena, const pm_scene *scene,
                      int process_id, bool sums) {
    const pm_scene_process *process = &scene->process[process_id];
    PM_TRY(list_parts(shape, arena, scene, process, sums));
    for (int i = 0; i < shape->npart; ++i) {
        const int id = process->subsystem[shape->part[i]];
        add_ends(shape, scene, id);
        shape->nz += sums ? 0 : scene->subsystem[id].layout.nz;
    }
    shape->ntally = sums ? PM_TALLY_NUMBERS : 0;
    const size_t size = sizeof(double) * (10 * (size_t)shape->npart + 4 * (size_t)shape->nend +
                                          (size_t)shape->nz + (size_t)shape->ntally);
    const int most = size < LARGEST_REPORT ? (int)(LARGEST_REPORT / size) : 1;
    const int lookahead = pm_lookahead(scene), half = lookahead > 1 ? lookahead / 2 : 1;
    shape->rows = half < most ? half : most;
    return PM_OK;
}

pm_status pm_report_shapes_init(pm_report_shape shape[2], pm_arena *arena, const pm_scene *scene,
                                int process_id) {
    shape[0] = shape[1] = (pm_report_shape){0};
    PM_TRY(init(&shape[0], arena, scene, process_id, false));
    return pm_scene_may_report_sums(scene) ? init(&shape[1], arena, scene, process_id, true)
                                           : PM_OK;
}

static int larger(int a, int b) {
    return a > b ? a : b;
}

pm_status pm_report_message_alloc(portmet_report_t *report, pm_arena *arena,
                                  const pm_report_shape shape[2]) {
    const pm_report_shape *a = &shape[0], *b = &shape[1];
    *report = (portmet_report_t){.npart = larger(a->rows * a->npart, b->rows * b->npart),
                                 .nend = larger(a->rows * a->nend, b->rows * b->nend),
                                 .nz = larger(a->rows * a->nz, b->rows * b->nz),
                                 .ntally = larger(a->rows * a->ntally, b->rows * b->ntally),
                                 .message = ""};
    const size_t p = (size_t)report->npart, e = (size_t)report->nend, z = (size_t)report->nz;
    double *memory =
        pm_arena_array(arena, 7 * p + 4 * e + z + (size_t)report->ntally, sizeof *memory);
    int64_t *counts = pm_arena_array(arena, 3 * p, sizeof *counts);
    if (memory == NULL || counts == NULL) {
        return no_memory();
    }
    double **const of_part[] = {
        &report->energy,       &report->entropy,           &report->bulk_energy,
        &report->bulk_entropy, &report->bulk_energy_gross, &report->bulk_entropy_gross,
        &report->error};
    double **const of_end[] = {&report->energy_flux, &report->entropy_flux, &report->energy_gross,
                               &report->entropy_gross};
    for (int i = 0; i < 7; ++i, memory += p) {
        *of_part[i] = memory;
    }
    for (int i = 0; i < 4; ++i, memory += e) {
        *of_end[i] = memory;
    }
    report->z = memory;
    report->tally = memory + z;
    report->evaluated = counts;
    report->skipped = counts + p;
    report->outside = counts + 2 * p;
    return PM_OK;
}

pm_status pm_report_ports_between(const pm_scene *scene, pm_arena *arena, int *count, int **port) {
    size_t all = 0;
    for (int i = 0; i < scene->nport; ++i) {
        all += pm_scene_joins_processes(scene, &scene->port[i]);
    }
    *count = 0;
    *port = pm_arena_array(arena, all, sizeof **port);
    if (*port == NULL) {
        return no_memory();
    }
    for (int i = 0; i < scene->nport; ++i) {
        if (pm_scene_joins_processes(scene, &scene->port[i])) {
            (*port)[(*count)++] = i;
        }
    }
    return PM_OK;
}
