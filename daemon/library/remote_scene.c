// Asks a coordinator that stays, and copies its replies into arrays that keep their place.
#include "library/remote_scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

// Takes over the numbers of the last reply.
static pm_status take(pm_remote_scene *s) {
    const portmet_control_reply_t *r = pm_remote_reply(s->client);
    if (r->nz != s->served->nz || r->nend != 2 * s->served->nport) {
        return pm_fail(PM_ECONFIG, "scene %s is too large: its replies have no state", s->name);
    }
    const double *const from[] = {r->z, r->part_energy, r->part_entropy, r->bulk_energy,
                                  r->bulk_entropy};
    for (int i = PORTMET_STATE; i <= PORTMET_BULK_ENTROPY; ++i) {
        memcpy((double *)s->array[i], from[i], s->size[i] * sizeof *from[i]);
    }
    double *flux = (double *)s->array[PORTMET_FLUX], *ledger = (double *)s->array[PORTMET_LEDGER];
    for (int i = 0; i < r->nend; ++i, flux += 4) {
        flux[0] = r->energy_flux[i];
        flux[1] = r->entropy_flux[i];
        flux[2] = r->energy_gross[i];
        flux[3] = r->entropy_gross[i];
    }
    ledger[PORTMET_FIRST_ENERGY] = r->first_energy;
    ledger[PORTMET_TOTAL_ENERGY] = r->energy;
    ledger[PORTMET_FIRST_ENTROPY] = r->first_entropy;
    ledger[PORTMET_TOTAL_ENTROPY] = r->entropy;
    ledger[PORTMET_ENERGY_DRIFT] = r->energy_drift;
    ledger[PORTMET_ENTROPY_FALL] = r->entropy_fall;
    ledger[PORTMET_OUTSIDE_ENERGY] = r->outside_energy;
    ledger[PORTMET_OUTSIDE_ENTROPY] = r->outside_entropy;
    ledger[PORTMET_ENERGY_RESIDUAL] = r->energy_residual;
    ledger[PORTMET_ENTROPY_RESIDUAL] = r->entropy_residual;
    ledger[PORTMET_VIOLATIONS] = (double)r->violations;
    // Before the first step nothing has flowed.
    for (int i = PORTMET_BULK_ENERGY; i <= PORTMET_FLUX && r->step == 0; ++i) {
        for (size_t k = 0; k < s->size[i]; ++k) {
            ((double *)s->array[i])[k] = NAN;
        }
    }
    s->step = r->step;
    s->time = r->time;
    return PM_OK;
}

// Returns the first live input without a value; -1: none.
static int first_unset(const pm_remote_scene *s) {
    int i = 0;
    while (i < s->served->nlive && !isnan(s->input[i])) {
        ++i;
    }
    return i < s->served->nlive ? i : -1;
}

// Holds the run where it is, and takes over what it has reached.
static pm_status hold(pm_remote_scene *s) {
    const portmet_control_t pause = {.kind = PORTMET_CONTROL_T_PAUSE};
    pm_remote_interrupt_after(s->client, 0);
    const pm_status status = pm_remote_ask(s->client, &pause, true);
    return status == PM_OK ? take(s) : status;
}

// Takes over the result of a request.
static pm_status finish(pm_remote_scene *s, pm_status status) {
    s->interrupted = status == PM_EINTERRUPTED;
    if (s->interrupted) {
        return status;
    }
    if (pm_remote_awaits_input(s->client)) {
        char reason[PM_TEXT_MAX + 1];
        const int unset = first_unset(s);
        snprintf(reason, sizeof reason, "%s%s%s%s", pm_error(), unset < 0 ? "" : ": the input ",
                 unset < 0 ? "" : s->served->live[unset], unset < 0 ? "" : " is not set");
        (void)hold(s);
        return pm_fail(PM_ETIMEOUT, "%s", reason);
    }
    // Where a run has failed, RESET begins another one.
    const int8_t phase = pm_remote_reply(s->client)->phase;
    const bool ended = status != PM_OK && status != PM_ETIMEOUT &&
                       phase != PORTMET_CONTROL_REPLY_T_RUNNING &&
                       phase != PORTMET_CONTROL_REPLY_T_HELD;
    s->running = s->running && !ended && (s->was_running || status == PM_OK);
    return status == PM_OK ? take(s) : status;
}

pm_status pm_remote_scene_wait(pm_remote_scene *s) {
    pm_remote_interrupt_after(s->client, s->slice);
    return finish(s, pm_remote_wait(s->client));
}

pm_status pm_remote_scene_ask(pm_remote_scene *s, portmet_control_t request) {
    const bool starts = request.kind == PORTMET_CONTROL_T_RESET;
    const bool stops = request.kind == PORTMET_CONTROL_T_STOP, running = s->running;
    const bool set = s->served->nlive > 0 && first_unset(s) < 0; // the inputs
    s->was_running = running;
    s->running = starts || (running && !stops);
    if (stops && !running) {
        return PM_OK;
    }
    if (s->interrupted && running && !stops) {
        PM_TRY(hold(s));
    }
    if (starts && !running) {
        request.kind = PORTMET_CONTROL_T_START;
        request.file = (char *)s->record;
    }
    const bool takes = starts || request.kind == PORTMET_CONTROL_T_SET ||
                       request.kind == PORTMET_CONTROL_T_ADVANCE;
    if (set && takes) {
        request.nlive = s->served->nlive;
        request.live = s->input;
    }
    pm_remote_interrupt_after(s->client, s->slice);
    return finish(s, pm_remote_ask(s->client, &request, !starts || running));
}

pm_status pm_remote_scene_open(pm_remote_scene *s, const pm_remote_address *address) {
    char host[64] = "";
    (void)gethostname(host, sizeof host - 1);
    const char *sender = pm_arena_printf(&s->arena, "program-%ld@%.40s", (long)getpid(), host);
    const char *colon = strchr(address->name, ':');
    const size_t length = colon == NULL ? strlen(address->name) : (size_t)(colon - address->name);
    s->name = pm_arena_printf(&s->arena, "%.*s", (int)length, address->name);
    char *end = NULL;
    const int64_t session = colon == NULL ? 0 : strtoll(colon + 1, &end, 10);
    if (end != NULL && (end == colon + 1 || *end != 0 || session < 1)) {
        return pm_fail(PM_EUSAGE, "%s: expected a number after the colon", address->name);
    }
    s->record = pm_arena_printf(&s->arena, "%s", address->record == NULL ? "" : address->record);
    PM_TRY(pm_arena_status(&s->arena, "scene %s", address->name));
    PM_TRY(pm_transport_open(&s->transport, address->url));
    if (address->key_file != NULL) {
        pm_key key;
        PM_TRY(pm_key_load(&key, address->key_file));
        const pm_status sealed = pm_transport_seal(s->transport, &key, sender, NULL, NULL);
        pm_key_clear(&key);
        PM_TRY(sealed);
    }
    PM_TRY(pm_remote_open(&s->client, s->transport,
                          &(pm_remote_options){s->name, sender, session, address->patience, NULL}));
    s->served = pm_remote_served(s->client);
    const size_t nz = (size_t)s->served->nz, n = (size_t)s->served->nsubsystem;
    const size_t nlive = (size_t)s->served->nlive;
    const size_t size[] = {nz, n, n, n, n, 8 * (size_t)s->served->nport, PORTMET_LEDGER_SIZE};
    for (int i = PORTMET_STATE; i <= PORTMET_LEDGER; ++i) {
        s->size[i] = size[i];
        s->array[i] = pm_arena_array(&s->arena, size[i], sizeof(double));
    }
    s->input = pm_arena_array(&s->arena, nlive, sizeof *s->input);
    PM_TRY(pm_arena_status(&s->arena, "scene %s", address->name));
    for (size_t i = 0; i < nlive; ++i) {
        s->input[i] = NAN;
    }
    const pm_served *v = s->served;
    const struct {
        const char *const *name;
        int count;
    } names[] = {
        [PORTMET_SUBSYSTEM] = {v->subsystem, v->nsubsystem},
        [PORTMET_VARIABLE] = {v->variable, v->nz},
        [PORTMET_VARIABLE_UNIT] = {v->unit, v->nz},
        [PORTMET_PORT] = {v->port, v->nport},
        [PORTMET_PORT_A] = {v->end_a, v->nport},
        [PORTMET_PORT_B] = {v->end_b, v->nport},
        [PORTMET_INPUT] = {v->live, v->nlive},
        [PORTMET_INPUT_UNIT] = {v->live_unit, v->nlive},
        [PORTMET_REFERENCE] = {NULL, 0},
        [PORTMET_SCENE] = {&s->name, 1},
    };
    for (int i = 0; i <= PORTMET_SCENE; ++i) {
        s->names[i] = names[i].name;
        s->nname[i] = names[i].count;
    }
    return pm_remote_scene_ask(s,
                               (portmet_control_t){.kind = PORTMET_CONTROL_T_RESET, .held = true});
}
