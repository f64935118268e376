// The functions of the shared library, around a local run.
#include "library/portmet.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "library/fleet_gradient.h"
#include "library/local_run.h"
#include "library/names.h"
#include "library/remote_scene.h"

struct portmet_scene {
    pm_setup setup;
    pm_local_run run;
    pm_scene_variables variables;
    double *input;       // [nprescribed] held values, NaN: the scene's own
    const char **weight; // [nweight] names of the matrices of weights
    int nweight;
    double ledger[PORTMET_LEDGER_SIZE];
    pm_remote_scene *remote; // that other processes step; NULL: it is stepped here
    atomic_flag busy;        // a thread is changing the scene
};

const char *portmet_version(void) {
    return PM_VERSION;
}

const char *portmet_error(void) {
    return pm_error();
}

// --- opening ---

// Brings the arrays that the caller sees up to date. Before the first step nothing has flowed.
static void update_arrays(portmet_scene *s) {
    const pm_physics *physics = &s->setup.scene->physics;
    const pm_sample *sample = &s->run.sample;
    for (int i = 0; i < physics->nsubsystem && sample->step == 0; ++i) {
        sample->bulk_energy[i] = sample->bulk_entropy[i] = NAN;
    }
    for (int i = 0; i < physics->nport && sample->step == 0; ++i) {
        sample->flux[i][0] = sample->flux[i][1] = (pm_flux){NAN, NAN, NAN, NAN};
    }
    const pm_ledger *ledger = &s->run.ledger;
    const double value[PORTMET_LEDGER_SIZE] = {
        [PORTMET_FIRST_ENERGY] = ledger->first_energy,
        [PORTMET_TOTAL_ENERGY] = ledger->energy,
        [PORTMET_FIRST_ENTROPY] = ledger->first_entropy,
        [PORTMET_TOTAL_ENTROPY] = ledger->entropy,
        [PORTMET_ENERGY_DRIFT] = ledger->energy_drift,
        [PORTMET_ENTROPY_FALL] = ledger->worst_entropy_fall,
        [PORTMET_OUTSIDE_ENERGY] = ledger->outside_energy,
        [PORTMET_OUTSIDE_ENTROPY] = ledger->outside_entropy,
        [PORTMET_ENERGY_RESIDUAL] = ledger->worst_energy,
        [PORTMET_ENTROPY_RESIDUAL] = ledger->worst_entropy,
        [PORTMET_VIOLATIONS] = (double)ledger->violations,
    };
    for (int i = 0; i < PORTMET_LEDGER_SIZE; ++i) {
        s->ledger[i] = value[i];
    }
}

// Takes over `scene`.
static pm_status open_run(portmet_scene *s, pm_scene *scene, const char *weights) {
    const int n = scene->physics.nprescribed;
    PM_TRY(pm_setup_open(&s->setup, scene, weights));
    PM_TRY(pm_setup_complete(&s->setup, PM_TO_SERVE));
    s->input = pm_arena_array(&s->setup.arena, (size_t)n, sizeof *s->input);
    PM_TRY(pm_arena_status(&s->setup.arena, "boundary inputs"));
    for (int i = 0; i < n; ++i) {
        s->input[i] = NAN;
    }
    s->setup.boundary_input.held = s->input;
    PM_TRY(pm_scene_variable_names(&s->variables, scene, &s->setup.arena));
    PM_TRY(pm_fleet_weight_names(s->setup.system, &s->nweight, &s->weight, &s->setup.arena));
    return pm_local_run_open(&s->run, &s->setup, PM_LOCAL_UNDO);
}

static const char *scene_name(const portmet_scene *scene) {
    return scene->remote != NULL ? scene->remote->name : scene->setup.scene->name;
}

// Begins a call that changes the scene, unless another thread is changing it.
static pm_status enter(portmet_scene *scene) {
    pm_forget_error();
    return !atomic_flag_test_and_set(&scene->busy)
               ? PM_OK
               : pm_fail(PM_EUSAGE, "scene %s: another thread is using it", scene_name(scene));
}

static int leave(portmet_scene *scene, pm_status status) {
    if (scene->remote == NULL) {
        update_arrays(scene);
    }
    if (status == PM_OK) {
        pm_forget_error();
    }
    atomic_flag_clear(&scene->busy);
    return (int)status;
}

static pm_status open_scene(portmet_scene **scene, pm_scene *description, const char *weights) {
    pm_linalg_init();
    portmet_scene *s = calloc(1, sizeof *s);
    if (s == NULL) {
        pm_scene_free(description);
        return pm_fail(PM_ENOMEM, "out of memory for a scene");
    }
    atomic_flag_clear(&s->busy);
    const pm_status status = open_run(s, description, weights);
    if (status != PM_OK) {
        portmet_scene_close(s);
        return status;
    }
    *scene = s;
    return (pm_status)leave(s, PM_OK);
}

int portmet_scene_open(portmet_scene **scene, const char *path, const char *weights) {
    pm_scene *description = NULL;
    PM_TRY(pm_scene_load(&description, path));
    return (int)open_scene(scene, description, weights);
}

int portmet_scene_parse(portmet_scene **scene, const char *text, const char *path,
                        const char *weights) {
    pm_scene *description = NULL;
    PM_TRY(pm_scene_parse(&description, text, path));
    return (int)open_scene(scene, description, weights);
}

int portmet_scene_connect(portmet_scene **scene, const char *name, const char *url,
                          const char *key_file, const char *record, double patience) {
    if (!(patience >= 0)) {
        return (int)pm_fail(PM_EUSAGE, "scene %s: a patience of %g s: expected 0 or more", name,
                            patience);
    }
    const pm_remote_address address = {
        .name = name,
        .url = url == NULL ? "udpm://239.255.76.67:7667?ttl=0" : url,
        .key_file = key_file,
        .record = record,
        .patience = patience > 0 ? patience : 10,
    };
    if (pm_transport_has_ranks(address.url)) {
        return (int)pm_fail(PM_EUSAGE,
                            "%s connects the processes that mpirun has started, and no "
                            "others",
                            url);
    }
    portmet_scene *s = calloc(1, sizeof *s);
    pm_status status = pm_fail(PM_ENOMEM, "out of memory for a scene");
    if (s != NULL && (s->remote = calloc(1, sizeof *s->remote)) != NULL) {
        status = pm_remote_scene_open(s->remote, &address);
    }
    if (status != PM_OK) {
        portmet_scene_close(s);
        return (int)status;
    }
    *scene = s;
    return leave(s, PM_OK);
}

void portmet_scene_close(portmet_scene *scene) {
    if (scene != NULL && scene->remote != NULL) {
        pm_remote_scene *remote = scene->remote;
        if (remote->running) {
            remote->slice = 0;
            (void)pm_remote_scene_ask(remote, (portmet_control_t){.kind = PORTMET_CONTROL_T_STOP});
        }
        pm_remote_close(remote->client);
        pm_transport_close(remote->transport);
        PM_DELETE(remote);
        free(scene);
    } else if (scene != NULL) {
        (void)pm_recording_close(scene->run.recording);
        pm_local_run_close(&scene->run);
        pm_setup_free(&scene->setup);
        free(scene);
    }
}

static pm_status end_recording(portmet_scene *scene) {
    pm_recording *recording = scene->run.recording;
    scene->run.recording = NULL;
    return pm_recording_close(recording);
}

int portmet_scene_compile(portmet_scene *scene) {
    if (enter(scene) != PM_OK) {
        return PORTMET_EUSAGE;
    }
    if (scene->remote != NULL) {
        return leave(scene, pm_fail(PM_EUSAGE, "scene %s is stepped elsewhere", scene_name(scene)));
    }
    pm_local_run compiled;
    scene->setup.system->compiled = true;
    pm_status status = end_recording(scene);
    if (status == PM_OK) {
        status = pm_local_run_open(&compiled, &scene->setup, PM_LOCAL_UNDO);
        scene->setup.system->compiled = status == PM_OK;
        pm_local_run_close(status == PM_OK ? &scene->run : &compiled);
        scene->run = status == PM_OK ? compiled : scene->run;
    }
    return leave(scene, status);
}

// --- stepping ---

static pm_status take_steps(portmet_scene *scene, int64_t count) {
    if (count < 0) {
        return pm_fail(PM_EUSAGE, "scene %s: %lld steps: expected 0 or more", scene_name(scene),
                       (long long)count);
    }
    if (scene->remote != NULL && count > 0) {
        return pm_remote_scene_ask(scene->remote, (portmet_control_t){
                                                      .kind = PORTMET_CONTROL_T_ADVANCE,
                                                      .steps = count,
                                                  });
    }
    for (int64_t i = 0; i < count; ++i) {
        PM_TRY(pm_local_run_step(&scene->run));
    }
    return PM_OK;
}

int portmet_scene_step(portmet_scene *scene, int64_t count) {
    return enter(scene) != PM_OK ? PORTMET_EUSAGE : leave(scene, take_steps(scene, count));
}

static pm_status restart(portmet_scene *scene, const double *z) {
    const pm_remote_scene *remote = scene->remote;
    const int nz = remote != NULL ? remote->served->nz : scene->setup.scene->physics.nz;
    for (int i = 0; z != NULL && i < nz; ++i) {
        if (!isfinite(z[i])) {
            return pm_fail(PM_ENUMERIC, "scene %s: restart with %s = %g", scene_name(scene),
                           portmet_scene_name(scene, PORTMET_VARIABLE, (size_t)i), z[i]);
        }
    }
    if (remote != NULL) {
        return pm_remote_scene_ask(scene->remote, (portmet_control_t){
                                                      .kind = PORTMET_CONTROL_T_RESET,
                                                      .held = true,
                                                      .nz = z == NULL ? 0 : nz,
                                                      .z = (double *)z,
                                                  });
    }
    z = z == NULL ? scene->setup.initial : z;
    PM_TRY(pm_monolithic_check_state(scene->run.monolithic, z));
    PM_TRY(end_recording(scene));
    return pm_local_run_start(&scene->run, z);
}

int portmet_scene_restart(portmet_scene *scene, const double *z) {
    return enter(scene) != PM_OK ? PORTMET_EUSAGE : leave(scene, restart(scene, z));
}

int portmet_scene_copy(portmet_scene *scene, portmet_scene *from) {
    if (scene->remote != NULL || from->remote != NULL ||
        scene->setup.system->digest != from->setup.system->digest) {
        return (int)pm_fail(PM_EUSAGE, "scene %s: scene %s was not opened here from the same files",
                            scene_name(scene), scene_name(from));
    }
    const size_t n = (size_t)scene->setup.scene->physics.nprescribed;
    if (scene == from || enter(scene) != PM_OK) {
        return scene == from ? PORTMET_OK : PORTMET_EUSAGE;
    }
    pm_local_run *run = &scene->run;
    pm_status status = enter(from);
    if (status != PM_OK) {
        return leave(scene, status);
    }
    PM_TRY_DONE(end_recording(scene));
    PM_TRY_DONE(pm_monolithic_copy(run->monolithic, from->run.monolithic));
    if (n > 0) {
        memcpy(scene->input, from->input, n * sizeof *scene->input);
    }
    run->ledger = from->run.ledger;
    run->ledger.system = scene->setup.system;
    // The arrays of the sample are the run's own, filled by the copy.
    const pm_sample *own = pm_monolithic_sample(run->monolithic);
    run->sample = from->run.sample;
    run->sample.z = own->z;
#define OWN_NUMBER(type, name, series, unit) run->sample.name = own->name;
#define OWN_BULK(member, name, series, unit) run->sample.name = own->name;
    PM_SUBSYSTEM_NUMBERS(OWN_NUMBER, OWN_BULK)
    run->sample.flux = own->flux;
    run->sample.live = scene->setup.live;
done:
    atomic_flag_clear(&from->busy);
    return leave(scene, status);
}

int portmet_scene_efforts(portmet_scene *scene, double *coenergy, double *reaction) {
    if (enter(scene) != PM_OK) {
        return PORTMET_EUSAGE;
    }
    if (scene->remote != NULL) {
        return leave(scene, pm_fail(PM_EUSAGE, "scene %s is stepped elsewhere", scene_name(scene)));
    }
    pm_monolithic_efforts(scene->run.monolithic, coenergy, reaction);
    return leave(scene, PM_OK);
}

// Asks those who step the scene elsewhere.
static int ask(portmet_scene *scene, portmet_control_t request) {
    return enter(scene) != PM_OK
               ? PORTMET_EUSAGE
               : leave(scene, scene->remote != NULL ? pm_remote_scene_ask(scene->remote, request)
                                                    : pm_fail(PM_EUSAGE, "scene %s is stepped here",
                                                              scene_name(scene)));
}

int portmet_scene_set_state(portmet_scene *scene, const double *z) {
    const int nz = scene->remote == NULL ? 0 : scene->remote->served->nz;
    return ask(scene,
               (portmet_control_t){.kind = PORTMET_CONTROL_T_SET, .nz = nz, .z = (double *)z});
}

int portmet_scene_checkpoint(portmet_scene *scene, const char *name) {
    return ask(scene,
               (portmet_control_t){.kind = PORTMET_CONTROL_T_CHECKPOINT, .file = (char *)name});
}

int portmet_scene_restore(portmet_scene *scene, const char *name) {
    return ask(scene, (portmet_control_t){
                          .kind = PORTMET_CONTROL_T_RESTORE, .held = true, .file = (char *)name});
}

int portmet_scene_stop(portmet_scene *scene) {
    return enter(scene) != PM_OK
               ? PORTMET_EUSAGE
               : leave(scene,
                       scene->remote == NULL
                           ? PM_OK
                           : pm_remote_scene_ask(scene->remote, (portmet_control_t){
                                                                    .kind = PORTMET_CONTROL_T_STOP,
                                                                }));
}

int portmet_scene_interrupt_after(portmet_scene *scene, double seconds) {
    if (!(seconds >= 0) || scene->remote == NULL) {
        return (int)pm_fail(PM_EUSAGE, "scene %s: an interruption after %g s%s", scene_name(scene),
                            seconds, scene->remote == NULL ? ": it is stepped here" : "");
    }
    pm_forget_error();
    scene->remote->slice = seconds;
    return PORTMET_OK;
}

int portmet_scene_wait(portmet_scene *scene) {
    return enter(scene) != PM_OK
               ? PORTMET_EUSAGE
               : leave(scene, scene->remote != NULL ? pm_remote_scene_wait(scene->remote)
                                                    : pm_fail(PM_EUSAGE, "scene %s is stepped here",
                                                              scene_name(scene)));
}

int64_t portmet_scene_steps(const portmet_scene *scene) {
    return scene->remote != NULL ? scene->remote->step : scene->run.sample.step;
}

double portmet_scene_time(const portmet_scene *scene) {
    return scene->remote != NULL ? scene->remote->time : scene->run.sample.time;
}

double portmet_scene_dt(const portmet_scene *scene) {
    return scene->remote != NULL ? scene->remote->served->dt : scene->setup.scene->physics.dt;
}

int64_t portmet_scene_planned(const portmet_scene *scene) {
    return scene->remote != NULL ? scene->remote->served->steps : scene->setup.scene->run.steps;
}

// --- arrays and names ---

const double *portmet_scene_array(const portmet_scene *scene, int array, size_t *size) {
    if (array < PORTMET_STATE || array > PORTMET_LEDGER) {
        return NULL;
    }
    if (scene->remote != NULL) {
        if (size != NULL) {
            *size = scene->remote->size[array];
        }
        return scene->remote->array[array];
    }
    const pm_sample *sample = &scene->run.sample;
    const size_t nsubsystem = (size_t)scene->setup.scene->physics.nsubsystem;
    const struct {
        const double *value;
        size_t size;
    } arrays[] = {
        [PORTMET_STATE] = {sample->z, (size_t)scene->setup.scene->physics.nz},
        [PORTMET_ENERGY] = {sample->energy, nsubsystem},
        [PORTMET_ENTROPY] = {sample->entropy, nsubsystem},
        [PORTMET_BULK_ENERGY] = {sample->bulk_energy, nsubsystem},
        [PORTMET_BULK_ENTROPY] = {sample->bulk_entropy, nsubsystem},
        [PORTMET_FLUX] = {(const double *)sample->flux,
                          8 * (size_t)scene->setup.scene->physics.nport},
        [PORTMET_LEDGER] = {scene->ledger, PORTMET_LEDGER_SIZE},
    };
    if (size != NULL) {
        *size = arrays[array].size;
    }
    return arrays[array].value;
}

double *portmet_scene_inputs(portmet_scene *scene, size_t *size) {
    const pm_remote_scene *remote = scene->remote;
    const int n = remote != NULL ? remote->served->nlive : scene->setup.scene->physics.nprescribed;
    if (size != NULL) {
        *size = (size_t)n;
    }
    return n == 0 ? NULL : remote != NULL ? remote->input : scene->input;
}

static const char *name_of(const char *const *name, int count, size_t index) {
    return index < (size_t)count ? name[index] : NULL;
}

const char *portmet_scene_name(const portmet_scene *scene, int kind, size_t index) {
    const pm_remote_scene *remote = scene->remote;
    if (remote != NULL) {
        return kind < 0 || kind > PORTMET_SCENE
                   ? NULL
                   : name_of(remote->names[kind], remote->nname[kind], index);
    }
    const pm_scene *s = scene->setup.scene;
    const pm_physics *physics = &s->physics;
    const pm_scene_variables *v = &scene->variables;
    const int nz = physics->nz, ninput = physics->nprescribed;
    if (kind == PORTMET_SUBSYSTEM) {
        return index < (size_t)physics->nsubsystem ? physics->subsystem[index].name : NULL;
    }
    if (kind == PORTMET_PORT || kind == PORTMET_PORT_A || kind == PORTMET_PORT_B) {
        return index >= (size_t)physics->nport ? NULL
               : kind == PORTMET_PORT
                   ? physics->port[index].name
                   : pm_scene_end_name(s, &physics->port[index], kind == PORTMET_PORT_B);
    }
    const struct {
        const char *const *name;
        int count;
    } names[] = {
        [PORTMET_VARIABLE] = {v->state.name, nz},
        [PORTMET_VARIABLE_UNIT] = {v->state.unit, nz},
        [PORTMET_INPUT] = {v->input.name, ninput},
        [PORTMET_INPUT_UNIT] = {v->input.unit, ninput},
        [PORTMET_REFERENCE] = {&s->run.reference, 1},
        [PORTMET_SCENE] = {&s->name, 1},
        [PORTMET_COENERGY_NAME] = {v->slope[0].name, nz},
        [PORTMET_COENERGY_UNIT] = {v->slope[0].unit, nz},
        [PORTMET_REACTION] = {v->reaction.name, ninput / 3},
        [PORTMET_REACTION_UNIT] = {v->reaction.unit, ninput / 3},
        [PORTMET_WEIGHT] = {scene->weight, scene->nweight},
    };
    return kind < 0 || kind > PORTMET_WEIGHT ? NULL
                                             : name_of(names[kind].name, names[kind].count, index);
}

// --- recording ---

static pm_status record(portmet_scene *scene, const char *path) {
    if (scene->remote != NULL) {
        return pm_fail(PM_EUSAGE,
                       "scene %s is recorded where it is stepped, under the name that "
                       "portmet_scene_connect was given",
                       scene_name(scene));
    }
    PM_TRY(end_recording(scene));
    if (path == NULL) {
        return PM_OK;
    }
    PM_TRY(pm_recording_check(path, false));
    PM_TRY(pm_recording_open(&scene->run.recording, path, scene->setup.scene));
    return pm_recording_append(scene->run.recording, &scene->run.sample);
}

int portmet_scene_record(portmet_scene *scene, const char *path) {
    return enter(scene) != PM_OK ? PORTMET_EUSAGE : leave(scene, record(scene, path));
}

// --- copies ---

struct portmet_fleet {
    pm_fleet fleet;
    atomic_flag busy; // a thread is changing the fleet
};

int portmet_fleet_open(portmet_fleet **fleet, const portmet_scene *scene, int64_t count,
                       int threads) {
    if (scene->remote != NULL) {
        return (int)pm_fail(PM_EUSAGE, "scene %s is stepped elsewhere", scene_name(scene));
    }
    portmet_fleet *f = NULL;
    PM_TRY(PM_NEW(f, "copies"));
    atomic_flag_clear(&f->busy);
    const pm_status status = pm_fleet_open(&f->fleet, &scene->setup, count, threads);
    if (status != PM_OK) {
        portmet_fleet_close(f);
        return (int)status;
    }
    *fleet = f;
    pm_forget_error();
    return PORTMET_OK;
}

void portmet_fleet_close(portmet_fleet *fleet) {
    if (fleet != NULL) {
        pm_fleet_close(&fleet->fleet);
        free(fleet);
    }
}

void *portmet_fleet_array(const portmet_fleet *fleet, int array) {
    const pm_fleet *f = &fleet->fleet;
    void *const arrays[] = {[PORTMET_FLEET_STATE] = f->z,
                            [PORTMET_FLEET_INPUTS] =
                                f->setup->scene->physics.nprescribed > 0 ? f->input : NULL,
                            [PORTMET_FLEET_ENERGY] = f->energy,
                            [PORTMET_FLEET_ENTROPY] = f->entropy,
                            [PORTMET_FLEET_STEPS] = f->step,
                            [PORTMET_FLEET_ENDED] = f->ended};
    return array < 0 || array > PORTMET_FLEET_ENDED ? NULL : arrays[array];
}

// Begins and ends a call that changes a fleet, with a number of steps or copies.
static pm_status enter_fleet(portmet_fleet *fleet, int64_t count) {
    pm_forget_error();
    if (count < 0) {
        return pm_fail(PM_EUSAGE, "%lld steps or copies: expected 0 or more", (long long)count);
    }
    return !atomic_flag_test_and_set(&fleet->busy)
               ? PM_OK
               : pm_fail(PM_EUSAGE, "another thread is using the copies");
}

static int leave_fleet(portmet_fleet *fleet, pm_status status) {
    if (status == PM_OK) {
        pm_forget_error();
    }
    atomic_flag_clear(&fleet->busy);
    return (int)status;
}

int portmet_fleet_step(portmet_fleet *fleet, int64_t count) {
    if (enter_fleet(fleet, count) != PM_OK) {
        return PORTMET_EUSAGE;
    }
    pm_fleet_step(&fleet->fleet, count);
    return leave_fleet(fleet, PM_OK);
}

const char *portmet_fleet_failure(const portmet_fleet *fleet) {
    return fleet->fleet.why;
}

size_t portmet_fleet_row(const portmet_fleet *fleet) {
    return (size_t)fleet->fleet.row;
}

int portmet_fleet_save(portmet_fleet *fleet, int64_t count, const int64_t *copy, double *rows) {
    return enter_fleet(fleet, count) != PM_OK
               ? PORTMET_EUSAGE
               : leave_fleet(fleet, pm_fleet_copy(&fleet->fleet, false, count, copy, rows));
}

int portmet_fleet_restore(portmet_fleet *fleet, int64_t count, const int64_t *copy,
                          const double *rows) {
    return enter_fleet(fleet, count) != PM_OK
               ? PORTMET_EUSAGE
               : leave_fleet(fleet,
                             pm_fleet_copy(&fleet->fleet, true, count, copy, (double *)rows));
}

int portmet_fleet_vjp(portmet_fleet *fleet, int64_t pieces, int64_t steps, const double *start,
                      const double *inputs, const double *seed, double *by_start, double *by_inputs,
                      double *by_weights) {
    const pm_fleet_rollout rollout = {pieces, steps, start, inputs};
    return enter_fleet(fleet, 0) != PM_OK
               ? PORTMET_EUSAGE
               : leave_fleet(fleet, pm_fleet_vjp(&fleet->fleet, &rollout, seed, by_start, by_inputs,
                                                 by_weights));
}

int portmet_fleet_jvp(portmet_fleet *fleet, int64_t pieces, int64_t steps, const double *start,
                      const double *inputs, const double *d_start, const double *d_inputs,
                      const double *d_weights, double *states, double *d_states) {
    const pm_fleet_rollout rollout = {pieces, steps, start, inputs};
    return enter_fleet(fleet, 0) != PM_OK
               ? PORTMET_EUSAGE
               : leave_fleet(fleet, pm_fleet_jvp(&fleet->fleet, &rollout, d_start, d_inputs,
                                                 d_weights, states, d_states));
}
