// Decodes a process's reports and distributes their numbers to samples.
#include "lockstep/remote_process.h"

#include <string.h>

#include "base/digest.h"
#include "lockstep/flux_link.h"
#include "sim/subsystem.h"
#include "transport/channel.h"

pm_status pm_remote_process_init(pm_remote_process *remote, pm_arena *arena, const pm_scene *scene,
                                 int process_id) {
    remote->id = process_id;
    remote->name = scene->process[process_id].name;
    remote->scene = scene;
    remote->done = -1;
    memset(remote->seen_step, -1, sizeof remote->seen_step);
    PM_TRY(pm_channel_process(remote->channel, scene, "REPORT", process_id));
    PM_TRY(pm_channel_process(remote->flux_channel, scene, "FLUX", process_id));
    PM_TRY(pm_channel_request(remote->address, scene, remote->name));
    PM_TRY(pm_report_shapes_init(remote->shape, arena, scene, process_id));
    PM_TRY(pm_flux_message_alloc(&remote->flux, arena, scene, process_id));
    PM_TRY(pm_report_message_alloc(&remote->report, arena, remote->shape));
    remote->most_part = remote->report.npart;
    remote->most_end = remote->report.nend;
    remote->most_z = remote->report.nz;
    remote->most_tally = remote->report.ntally;
    return PM_OK;
}

// Returns the shape of the report decoded last.
static const pm_report_shape *shape_of(const pm_remote_process *remote) {
    return &remote->shape[pm_remote_process_has_sums(remote)];
}

int pm_remote_process_rows(const pm_remote_process *remote) {
    return pm_remote_process_has_sums(remote) ? remote->report.ntally / PM_TALLY_NUMBERS
                                              : remote->report.npart / remote->shape[0].npart;
}

bool pm_remote_process_has_sums(const pm_remote_process *remote) {
    return remote->report.ntally > 0;
}

pm_drop pm_remote_process_decode(pm_remote_process *remote, const void *data, size_t size,
                                 bool with_state) {
    portmet_report_t *r = &remote->report;
    r->npart = remote->most_part;
    r->nend = remote->most_end;
    r->nz = remote->most_z;
    r->ntally = remote->most_tally;
    const pm_drop drop = pm_report_decode(r, data, size);
    if (drop != PM_KEEP || r->kind != PORTMET_REPORT_T_DONE) {
        return drop;
    }
    const int rows = pm_remote_process_rows(remote);
    const bool sums = pm_scene_may_report_sums(remote->scene) && !with_state;
    const pm_report_shape *shape = &remote->shape[sums];
    const bool whole = rows > 0 && r->npart == rows * shape->npart &&
                       r->nend == rows * shape->nend && r->ntally == rows * shape->ntally &&
                       r->nz == (with_state ? rows * shape->nz : 0);
    return whole ? PM_KEEP : PM_DROP_COUNT;
}

// Folds numbers into a digest, eight bytes at a time; quick, as every report passes through it.
static uint64_t fold(uint64_t digest, const void *value, int count) {
    for (int i = 0; i < count; ++i) {
        uint64_t bits;
        memcpy(&bits, (const char *)value + 8 * i, sizeof bits);
        digest = (digest ^ bits) * UINT64_C(0x9e3779b97f4a7c15);
        digest ^= digest >> 32;
    }
    return digest;
}

bool pm_remote_process_agrees(pm_remote_process *remote, int row, int64_t step) {
    const portmet_report_t *r = &remote->report;
    const pm_report_shape *shape = shape_of(remote);
    const int part = shape->npart, end = shape->nend;
    const void *const of_part[] = {r->energy,       r->entropy,           r->bulk_energy,
                                   r->bulk_entropy, r->bulk_energy_gross, r->bulk_entropy_gross,
                                   r->evaluated,    r->skipped,           r->outside,
                                   r->error};
    const double *const of_end[] = {r->energy_flux, r->entropy_flux, r->energy_gross,
                                    r->entropy_gross};
    uint64_t digest = PM_DIGEST_INIT;
    for (size_t i = 0; i < sizeof of_part / sizeof of_part[0]; ++i) {
        digest = fold(digest, (const char *)of_part[i] + 8 * row * part, part);
    }
    for (size_t i = 0; i < sizeof of_end / sizeof of_end[0]; ++i) {
        digest = fold(digest, of_end[i] + row * end, end);
    }
    digest = r->nz > 0 ? fold(digest, r->z + row * shape->nz, shape->nz) : digest;
    digest = fold(digest, r->tally + row * shape->ntally, shape->ntally);
    const int slot = (int)(step % PM_REMOTE_SEEN);
    if (remote->seen_step[slot] == step) {
        return remote->seen[slot] == digest;
    }
    remote->seen_step[slot] = step;
    remote->seen[slot] = digest;
    return true;
}

bool pm_remote_process_is_greeted(const pm_remote_process *remote, int64_t instance) {
    for (int i = 0; i < PM_REMOTE_GREETED; ++i) {
        if (remote->greeted[i] == instance) {
            return true;
        }
    }
    return false;
}

void pm_remote_process_greet(pm_remote_process *remote, int64_t instance) {
    if (!pm_remote_process_is_greeted(remote, instance)) {
        memmove(remote->greeted + 1, remote->greeted,
                (PM_REMOTE_GREETED - 1) * sizeof remote->greeted[0]);
        remote->greeted[0] = instance;
    }
}

void pm_remote_process_fill(const pm_remote_process *remote, int row, pm_sample *sample) {
    const portmet_report_t *r = &remote->report;
    const pm_scene_process *process = &remote->scene->process[remote->id];
    const pm_report_shape *shape = shape_of(remote);
    const double *z = r->nz > 0 ? r->z + row * shape->nz : NULL;
    for (int k = 0; k < shape->npart; ++k) {
        const int i = process->subsystem[shape->part[k]], from = row * shape->npart + k;
        const pm_books books = {
            .energy = r->energy[from],
            .entropy = r->entropy[from],
            .bulk = {r->bulk_energy[from], r->bulk_entropy[from], r->bulk_energy_gross[from],
                     r->bulk_entropy_gross[from]},
            .evaluated = (long)r->evaluated[from],
            .skipped = (long)r->skipped[from],
            .outside = (long)r->outside[from],
            .error = r->error[from],
        };
        pm_sample_set_books(sample, i, &books);
        if (z != NULL) {
            const pm_scene_subsystem *subsystem = &remote->scene->subsystem[i];
            memcpy(sample->z + subsystem->first, z, (size_t)subsystem->layout.nz * sizeof *z);
            z += subsystem->layout.nz;
        }
    }
    for (int k = 0; k < shape->nend; ++k) {
        const int from = row * shape->nend + k;
        sample->flux[shape->end[k] / 2][shape->end[k] % 2] =
            (pm_flux){r->energy_flux[from], r->entropy_flux[from], r->energy_gross[from],
                      r->entropy_gross[from]};
    }
}

void pm_remote_process_add_tally(const pm_remote_process *remote, int row, pm_tally *tally) {
    pm_tally own;
    if (pm_remote_process_has_sums(remote)) {
        memcpy(&own, remote->report.tally + row * PM_TALLY_NUMBERS, sizeof own);
        pm_tally_merge(tally, &own);
    }
}
