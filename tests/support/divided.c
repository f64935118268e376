// Processes in one program: each has its subsystems and looks for the other side of its ports.
#include "divided.h"
#include "tests/support/unit.h"

#include <stdlib.h>

#define MOST_EXPOSED 64 // components at one end of a port

static void new_division(divided *d, const pm_system *system, int count) {
    const size_t n = (size_t)system->scene->physics.nsubsystem;
    *d = (divided){system, count, calloc(n, sizeof(int)), calloc((size_t)count + 1, sizeof(int)),
                   calloc((size_t)count, sizeof(pm_local_subsystems *))};
    assert_true(d->id != NULL && d->first != NULL && d->local != NULL);
}

static void open_processes(divided *d) {
    for (int p = 0; p < d->count; ++p) {
        require(pm_local_subsystems_open(&d->local[p], d->system, d->first[p + 1] - d->first[p],
                                         d->id + d->first[p]));
    }
}

void divided_open(divided *d, const pm_system *system, int count, const int *process) {
    const int n = system->scene->physics.nsubsystem;
    new_division(d, system, process == NULL ? n : count);
    for (int p = 0, filled = 0; p < d->count; ++p) {
        for (int i = 0; i < n; ++i) {
            if ((process == NULL ? i : process[i]) == p) {
                d->id[filled++] = i;
            }
        }
        d->first[p + 1] = filled;
    }
    open_processes(d);
}

void divided_close(divided *d) {
    for (int p = 0; p < d->count; ++p) {
        pm_local_subsystems_close(d->local[p]);
    }
    free(d->id);
    free(d->first);
    free(d->local);
}

void divided_set_state(divided *d, const double *z) {
    for (int p = 0; p < d->count; ++p) {
        pm_local_subsystems_set_state(d->local[p], z);
    }
}

// Hands over to a process what another one shows at the other side of one of its remote ends.
static void hand_over(const divided *d, pm_local_subsystems *to, int remote) {
    const pm_remote_end at = pm_local_subsystems_remote(to, remote);
    for (int p = 0; p < d->count; ++p) {
        for (int k = 0; k < pm_local_subsystems_nremote(d->local[p]); ++k) {
            const pm_remote_end other = pm_local_subsystems_remote(d->local[p], k);
            if (other.port_id != at.port_id || other.end == at.end) {
                continue;
            }
            double y[MOST_EXPOSED], e[MOST_EXPOSED], eta[MOST_EXPOSED] = {0};
            double response[MOST_EXPOSED] = {0};
            int64_t known = 0;
            pm_local_subsystems_get_boundary(d->local[p], k, y, e, eta, response, &known);
            const pm_port_values values = {
                .ny = d->system->scene->physics.port[at.port_id].layout[other.end].nz,
                .y = y,
                .e = e,
                .eta = eta,
                .response = response,
                .known = (uint64_t)known};
            assert_in_range(values.ny, 0, MOST_EXPOSED);
            pm_local_subsystems_set_boundary(to, remote, &values);
        }
    }
}

pm_status divided_step(divided *d) {
    while (!pm_local_subsystems_completes_step(d->local[0])) {
        for (int p = 0; p < d->count; ++p) {
            pm_local_subsystems_bulk(d->local[p]);
            for (int k = 0; k < pm_local_subsystems_nremote(d->local[p]); ++k) {
                hand_over(d, d->local[p], k);
            }
        }
        for (int p = 0; p < d->count; ++p) {
            pm_local_subsystems_couple(d->local[p]);
        }
        for (int p = 0; p < d->count; ++p) {
            pm_local_subsystems_advance(d->local[p]);
        }
    }
    pm_status status = PM_OK;
    for (int p = 0; p < d->count; ++p) {
        const pm_status own = pm_local_subsystems_end_step(d->local[p]);
        status = status == PM_OK ? own : status;
    }
    return status;
}

void divided_fill_sample(const divided *d, pm_sample *sample) {
    for (int p = 0; p < d->count; ++p) {
        pm_local_subsystems_fill_sample(d->local[p], d->first[p + 1] - d->first[p], sample);
    }
}

void divided_return(divided *to, const divided *from) {
    const int n = from->system->scene->physics.nsubsystem;
    new_division(to, from->system, from->count);
    for (int i = 0; i < n; ++i) {
        to->id[i] = from->id[i];
    }
    for (int p = 0; p <= from->count; ++p) {
        to->first[p] = from->first[p];
    }
    open_processes(to);
    for (int p = 0; p < from->count; ++p) {
        pm_serializer count = pm_serializer_count("process");
        pm_local_subsystems_record(from->local[p], &count);
        double *memory = calloc((size_t)count.count + 1, sizeof *memory);
        assert_non_null(memory);
        pm_serializer save = pm_serializer_save("process", memory);
        pm_serializer restore = pm_serializer_restore("process", memory);
        pm_local_subsystems_record(from->local[p], &save);
        pm_local_subsystems_record(to->local[p], &restore);
        assert_int_equal(restore.count, count.count);
        free(memory);
    }
}
