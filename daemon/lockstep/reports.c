// Reports, from the books of a process to the samples of the coordinator.
#include "lockstep/reports.h"

#include <string.h>

#include "lockstep/lookahead.h"
#include "transport/channel.h"

#define LARGEST_REPORT 32768 // bytes of numbers in a report of several steps; avoids fragments

// --- what a report holds ---

// Returns a report without arrays for `rows` steps.
static portmet_report_t counts_of(const pm_report_shape *shape, int rows) {
    return (portmet_report_t){.npart = rows * shape->npart,
                              .nend = rows * shape->nend,
                              .nz = rows * shape->nz,
                              .ntally = rows * shape->ntally,
                              .message = ""};
}

// Sets the shape of the reports of a process without or with sums.
static pm_status find_shape(pm_report_shape *shape, pm_arena *arena, const pm_scene *scene,
                            int process_id, bool sums) {
    const pm_scene_process *process = &scene->network.process[process_id];
    const int *const first_end = scene->physics.first_end;
    size_t nend = 0;
    for (int i = 0; i < process->count; ++i) {
        const int id = process->subsystem[i];
        nend += sums && !pm_scene_lists_subsystem(scene, id)
                    ? 0
                    : 2 * (size_t)(first_end[id + 1] - first_end[id]);
    }
    shape->part = pm_arena_array(arena, (size_t)process->count, sizeof *shape->part);
    shape->end = pm_arena_array(arena, nend, sizeof *shape->end);
    PM_TRY(pm_arena_status(arena, "reports"));
    for (int i = 0; i < process->count; ++i) {
        const int id = process->subsystem[i], first = shape->nend;
        if (sums && !pm_scene_lists_subsystem(scene, id)) {
            continue;
        }
        shape->part[shape->npart++] = i;
        shape->nz += sums ? 0 : scene->physics.subsystem[id].layout.nz;
        for (int k = first_end[id]; k < first_end[id + 1]; ++k) {
            shape->end[shape->nend++] = scene->physics.end_at[k];
        }
        for (int k = first, last = shape->nend; k < last; ++k) {
            const int other = shape->end[k] ^ 1;
            if (scene->physics.port[other / 2].boundary_input[other % 2] >= 0) {
                shape->end[shape->nend++] = other;
            }
        }
    }
    shape->ntally = sums ? PM_TALLY_NUMBERS : 0;
    const portmet_report_t none = counts_of(shape, 0), one = counts_of(shape, 1);
    const size_t size = pm_report_size(&one) - pm_report_size(&none);
    const int most = size < LARGEST_REPORT ? (int)(LARGEST_REPORT / size) : 1;
    const int lookahead = pm_lookahead(scene), half = lookahead > 1 ? lookahead / 2 : 1;
    shape->rows = half < most ? half : most;
    return PM_OK;
}

static int larger(int a, int b) {
    return a > b ? a : b;
}

// Sets the shapes of the reports of a process: shape[0] without sums, and shape[1] with sums, which
// is zero if the scene may not report sums. Makes a message for as many steps as a report of either
// shape may hold; its counts are the largest possible ones.
static pm_status make_message(portmet_report_t *report, pm_report_shape shape[2], pm_arena *arena,
                              const pm_scene *scene, int process_id) {
    shape[0] = shape[1] = (pm_report_shape){0};
    PM_TRY(find_shape(&shape[0], arena, scene, process_id, false));
    if (pm_scene_may_report_sums(scene)) {
        PM_TRY(find_shape(&shape[1], arena, scene, process_id, true));
    }
    const portmet_report_t sums = counts_of(&shape[1], shape[1].rows);
    *report = counts_of(&shape[0], shape[0].rows);
    report->npart = larger(report->npart, sums.npart);
    report->nend = larger(report->nend, sums.nend);
    report->nz = larger(report->nz, sums.nz);
    report->ntally = larger(report->ntally, sums.ntally);
    return pm_report_alloc(report, arena);
}

// --- a process's side ---

pm_status pm_reporter_init(pm_reporter *reporter, pm_arena *arena, const pm_system *system,
                           int process_id, pm_transport *transport, int64_t instance, int more) {
    pm_reporter *r = reporter;
    const pm_scene *scene = system->scene;
    r->scene = scene;
    r->process = &scene->network.process[process_id];
    r->transport = transport;
    PM_TRY(pm_channel_process(r->sent.channel, scene, "REPORT", process_id));
    PM_TRY(make_message(&r->done, r->shape, arena, scene, process_id));
    // The coordinator may miss the report of any granted step, and a report may hold only one.
    const int depth = pm_lookahead(scene) + 1 + more;
    PM_TRY(pm_resend_buffer_init(&r->sent, arena, depth, pm_report_size(&r->done)));
    r->notice = (portmet_report_t){.instance = instance, .digest = (int64_t)system->digest};
    r->notice_capacity = pm_report_size(&(portmet_report_t){.message = ""}) + PM_TEXT_MAX;
    r->notice_data = pm_arena_alloc(arena, r->notice_capacity);
    r->first = pm_arena_array(arena, (size_t)depth, sizeof *r->first);
    r->last = pm_arena_array(arena, (size_t)depth, sizeof *r->last);
    r->done.instance = instance;
    r->done.digest = r->notice.digest;
    r->done.kind = PORTMET_REPORT_T_DONE;
    return pm_arena_status(arena, "the reports of %s", r->process->name);
}

pm_status pm_reporter_notify(pm_reporter *reporter, int64_t session, int64_t coordinator,
                             int8_t kind, pm_status code, const char *message) {
    portmet_report_t *m = &reporter->notice;
    m->session = session;
    m->coordinator = coordinator;
    m->kind = kind;
    m->code = (int8_t)code;
    m->message = (char *)message;
    const size_t size = pm_report_encode(m, reporter->notice_data, reporter->notice_capacity);
    return pm_transport_publish(reporter->transport, reporter->sent.channel, reporter->notice_data,
                                size);
}

static bool is_finite(const pm_books *books) {
    double nothing = 0; // becomes NaN
#define ADD(type, name, series, unit) nothing += 0 * (double)books->name;
#define ADD_BULK(member, name, series, unit) nothing += 0 * books->bulk.member;
#define ADD_END(member, name, series, unit) nothing += 0 * books->flux[i].member;
    PM_SUBSYSTEM_NUMBERS(ADD, ADD_BULK)
    for (int i = 0; i < books->nflux; ++i) {
        PM_END_NUMBERS(ADD_END)
    }
    return nothing == 0;
}

pm_status pm_reporter_add_step(pm_reporter *reporter, const portmet_report_t *head,
                               const pm_process_subsystems *subsystems, bool with_state) {
    pm_reporter *r = reporter;
    portmet_report_t *m = &r->done;
    r->sums = r->shape[1].ntally > 0 && !with_state;
    const pm_report_shape *shape = &r->shape[r->sums];
    if (r->rows == 0) {
        m->session = head->session;
        m->coordinator = head->coordinator;
        m->step = head->step;
        m->time = head->time;
        m->nz = 0;
    }
    if (r->sums) {
        pm_tally tally = {0};
        pm_local_subsystems_tally(subsystems->local, &tally);
        memcpy(m->tally + (ptrdiff_t)r->rows * PM_TALLY_NUMBERS, &tally, sizeof tally);
    } else {
        // A report with a number that is not finite cannot be encoded. The steps before it are
        // published, and the run ends.
        for (int i = 0; i < subsystems->count; ++i) {
            const pm_books books = pm_local_subsystems_books(subsystems->local, i);
            if (!is_finite(&books)) {
                PM_TRY(pm_reporter_flush(r));
                return pm_fail(PM_ENUMERIC, "subsystem %s: a flux is not finite in step %lld",
                               r->scene->physics.subsystem[r->process->subsystem[i]].name,
                               (long long)head->step);
            }
        }
    }
    int end = r->rows * shape->nend;
    for (int i = 0; i < shape->npart; ++i) {
        const int id = shape->part[i], part = r->rows * shape->npart + i;
        const pm_books books = pm_local_subsystems_books(subsystems->local, id);
#define PUT(type, name, series, unit) m->name[part] = books.name;
#define PUT_BULK(member, name, series, unit) m->name[part] = books.bulk.member;
#define PUT_END(member, name, series, unit) m->name[end] = books.flux[k].member;
        PM_SUBSYSTEM_NUMBERS(PUT, PUT_BULK)
        for (int k = 0; k < books.nflux; ++k, ++end) {
            PM_END_NUMBERS(PUT_END)
        }
        if (with_state) {
            pm_local_subsystems_state(subsystems->local, id, m->z + m->nz);
            m->nz += r->scene->physics.subsystem[r->process->subsystem[id]].layout.nz;
        }
    }
    r->rows += 1;
    return r->rows < shape->rows ? PM_OK : pm_reporter_flush(r);
}

pm_status pm_reporter_flush(pm_reporter *reporter) {
    pm_reporter *r = reporter;
    portmet_report_t *m = &r->done;
    if (r->rows == 0) {
        return PM_OK;
    }
    m->npart = r->rows * r->shape[r->sums].npart;
    m->nend = r->rows * r->shape[r->sums].nend;
    m->ntally = r->rows * r->shape[r->sums].ntally;
    const int64_t last = m->step + r->rows - 1;
    r->rows = 0;
    unsigned char *data = pm_resend_buffer_data(&r->sent);
    const size_t size = pm_report_encode(m, data, r->sent.capacity);
    if (size == 0) {
        return pm_fail(PM_ENUMERIC,
                       "process %s: a state, energy, entropy or flux is not finite after step "
                       "%lld to %lld",
                       r->process->name, (long long)m->step, (long long)last);
    }
    r->first[r->count % r->sent.depth] = m->step;
    r->last[r->count % r->sent.depth] = last;
    return pm_resend_buffer_publish(&r->sent, r->transport, r->count++, size);
}

pm_status pm_reporter_repeat(const pm_reporter *reporter, int64_t step, bool *kept) {
    const pm_reporter *r = reporter;
    const int64_t oldest = r->count > r->sent.depth ? r->count - r->sent.depth : 0;
    for (int64_t i = oldest; i < r->count; ++i) {
        const int64_t slot = i % r->sent.depth;
        if (r->first[slot] <= step && step <= r->last[slot]) {
            return pm_resend_buffer_repeat(&r->sent, r->transport, i, kept);
        }
    }
    *kept = false;
    return PM_OK;
}

// --- the side of those who read them ---

pm_status pm_remote_process_init(pm_remote_process *remote, pm_arena *arena, const pm_scene *scene,
                                 int process_id) {
    remote->id = process_id;
    remote->name = scene->network.process[process_id].name;
    remote->scene = scene;
    remote->done = -1;
    memset(remote->seen_step, -1, sizeof remote->seen_step);
    PM_TRY(pm_channel_process(remote->channel, scene, "REPORT", process_id));
    PM_TRY(pm_channel_process(remote->flux_channel, scene, "FLUX", process_id));
    PM_TRY(pm_channel_request(remote->address, scene, remote->name));
    PM_TRY(make_message(&remote->largest, remote->shape, arena, scene, process_id));
    return pm_flux_message_alloc(&remote->flux, arena, scene, process_id);
}

pm_drop pm_remote_process_decode(pm_remote_process *remote, const void *data, size_t size,
                                 bool with_state) {
    portmet_report_t *r = &remote->report;
    *r = remote->largest;
    const pm_drop drop = pm_report_decode(r, data, size);
    if (drop != PM_KEEP || r->kind != PORTMET_REPORT_T_DONE) {
        return drop;
    }
    remote->sums = pm_scene_may_report_sums(remote->scene) && !with_state;
    const pm_report_shape *shape = &remote->shape[remote->sums];
    const int rows = remote->sums ? r->ntally / shape->ntally : r->npart / shape->npart;
    remote->rows = rows;
    const bool whole = rows > 0 && r->npart == rows * shape->npart &&
                       r->nend == rows * shape->nend && r->ntally == rows * shape->ntally &&
                       r->nz == (with_state ? rows * shape->nz : 0);
    return whole ? PM_KEEP : PM_DROP_COUNT;
}

// Writes what a process lists in row `row` of its report into the sample of that step.
static void fill(const pm_remote_process *remote, int row, pm_sample *sample) {
    const portmet_report_t *r = &remote->report;
    const pm_scene_process *process = &remote->scene->network.process[remote->id];
    const pm_report_shape *shape = &remote->shape[remote->sums];
    const double *z = r->nz > 0 ? r->z + (ptrdiff_t)row * shape->nz : NULL;
    for (int k = 0; k < shape->npart; ++k) {
        const int id = process->subsystem[shape->part[k]], from = row * shape->npart + k;
#define TAKE(type, name, series, unit) sample->name[id] = (type)r->name[from];
#define TAKE_BULK(member, name, series, unit) sample->name[id] = r->name[from];
        PM_SUBSYSTEM_NUMBERS(TAKE, TAKE_BULK)
        if (z != NULL) {
            const pm_scene_subsystem *subsystem = &remote->scene->physics.subsystem[id];
            memcpy(sample->z + subsystem->first, z, (size_t)subsystem->layout.nz * sizeof *z);
            z += subsystem->layout.nz;
        }
    }
    for (int k = 0; k < shape->nend; ++k) {
        const int from = row * shape->nend + k;
        pm_flux *flux = &sample->flux[shape->end[k] / 2][shape->end[k] % 2];
#define TAKE_END(member, name, series, unit) flux->member = r->name[from];
        PM_END_NUMBERS(TAKE_END)
    }
}

// --- the samples of several steps ---

static pm_report_window_slot *slot_of(const pm_report_window *window, int64_t step) {
    return &window->slot[step % window->depth];
}

static void begin(const pm_report_window *window, int64_t step) {
    const pm_scene *scene = window->scene;
    pm_report_window_slot *slot = slot_of(window, step);
    slot->step = step;
    slot->missing = scene->network.nprocess;
    slot->tally = (pm_tally){0};
    memset(slot->has, 0, (size_t)scene->network.nprocess * sizeof *slot->has);
    slot->sample->step = (long)step;
    slot->sample->time = pm_scene_time(scene, step);
}

pm_status pm_report_window_init(pm_report_window *window, pm_arena *arena, const pm_scene *scene,
                                int depth, int64_t first) {
    const size_t n = (size_t)scene->network.nprocess;
    window->scene = scene;
    window->slot = pm_arena_array(arena, (size_t)depth, sizeof *window->slot);
    bool *has = pm_arena_array(arena, (size_t)depth * n, sizeof *has);
    PM_TRY(pm_arena_status(arena, "reports"));
    for (int i = 0; i < depth; ++i) {
        window->slot[i].has = has + (size_t)i * n;
        PM_TRY(pm_sample_new(&window->slot[i].sample, scene));
        window->depth = i + 1;
    }
    pm_report_window_restart(window, first);
    return PM_OK;
}

void pm_report_window_restart(pm_report_window *window, int64_t first) {
    for (int i = 0; i < window->depth; ++i) {
        begin(window, first + i);
    }
}

int64_t pm_report_window_reach(pm_report_window *window, int64_t step) {
    const int64_t before = slot_of(window, step)->step;
    if (before >= step) {
        return -1;
    }
    begin(window, step);
    return before;
}

void pm_report_window_free(pm_report_window *window) {
    for (int i = 0; i < window->depth; ++i) {
        pm_sample_free(window->slot[i].sample);
    }
}

bool pm_report_window_add(pm_report_window *window, const pm_remote_process *remote, int row) {
    const int64_t step = remote->report.step + row;
    pm_report_window_slot *slot = slot_of(window, step);
    if (slot->step != step || slot->has[remote->id]) {
        return false;
    }
    fill(remote, row, slot->sample);
    if (remote->sums) {
        pm_tally own;
        memcpy(&own, remote->report.tally + (ptrdiff_t)row * PM_TALLY_NUMBERS, sizeof own);
        pm_tally_merge(&slot->tally, &own);
    }
    slot->has[remote->id] = true;
    slot->missing -= 1;
    return true;
}

bool pm_report_window_has(const pm_report_window *window, int64_t step, int process_id) {
    const pm_report_window_slot *slot = slot_of(window, step);
    return slot->step == step && slot->has[process_id];
}

bool pm_report_window_is_complete(const pm_report_window *window, int64_t step) {
    const pm_report_window_slot *slot = slot_of(window, step);
    return slot->step == step && slot->missing == 0;
}

int64_t pm_report_window_complete(const pm_report_window *window, int64_t step, int64_t most) {
    while (step < most && pm_report_window_is_complete(window, step + 1)) {
        ++step;
    }
    return step;
}

pm_sample *pm_report_window_sample(const pm_report_window *window, int64_t step) {
    return slot_of(window, step)->sample;
}

pm_tally *pm_report_window_tally(const pm_report_window *window, int64_t step) {
    return &slot_of(window, step)->tally;
}

void pm_report_window_advance(pm_report_window *window, int64_t step) {
    begin(window, step + window->depth);
}
