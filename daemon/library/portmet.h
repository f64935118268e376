/* SPDX-License-Identifier: MIT */
/* libportmet: opens a scene of learned thermodynamic subsystems and steps it in the caller's
 * process.
 *
 *     portmet_scene *scene;
 *     if (portmet_scene_open(&scene, "double_pendulum.yaml", NULL) != PORTMET_OK) {
 *         puts(portmet_error());
 *     }
 *     portmet_scene_step(scene, 200);
 *     const double *z = portmet_scene_array(scene, PORTMET_STATE, NULL);
 *     portmet_scene_close(scene);
 *
 * No function prints, exits or changes global state. A function that can fail returns 0 on success
 * and else a code of portmet_status, and portmet_error() says in one line what failed. The numbers
 * of a run are those of `portmetd run`, bit by bit. Threads may use different scenes at the same
 * time; one scene belongs to one thread at a time: a call for a scene that another thread is
 * stepping, restarting or recording is refused with PORTMET_EUSAGE. All numbers are in SI units.
 *
 * The interface grows only at its end: a program that was linked with this version runs with every
 * later one of the same major number. */
#ifndef PORTMET_H
#define PORTMET_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

/* The codes are the exit codes of the programs. */
enum portmet_status {
    PORTMET_OK = 0,
    PORTMET_ECONFIG = 3,  /* the scene has a wrong key, type, name or value */
    PORTMET_EFILE = 4,    /* a file is missing, unreadable, truncated or of another kind */
    PORTMET_EDATA = 5,    /* a dataset lacks columns, has a wrong shape, or ends before the run */
    PORTMET_EWEIGHTS = 6, /* weights are missing, damaged or not made for this scene */
    PORTMET_ENET = 7,     /* there is no route for multicast, or a process of the run has died */
    PORTMET_ETIMEOUT = 8, /* nobody answers */
    PORTMET_ENUMERIC = 9, /* a value is not finite, or a guard of the scene ended the run */
    PORTMET_ELAW = 10,    /* a component in the hard form violated a law beyond its tolerance */
    PORTMET_ENOMEM = 11,  /* out of memory */
    PORTMET_EUSAGE = 2,   /* an argument is not valid */
    PORTMET_EINTERRUPTED = 12 /* there is no answer yet: portmet_scene_interrupt_after */
};

/* Returns the version of the library, such as "0.1.0". */
const char *portmet_version(void);

/* Returns the description of the failure of this thread's last call that can fail: one line, "" if
 * it succeeded. It is valid until the next such call of this thread. */
const char *portmet_error(void);

typedef struct portmet_scene portmet_scene;

/* Opens the scene file at `path`; the scene is then at step 0, in its initial state. The weights
 * come from the files that the scene names, or, if `weights` is not NULL, from files of these names
 * in the folder `weights`. The caller closes the scene. */
int portmet_scene_open(portmet_scene **scene, const char *path, const char *weights);
/* Opens a scene from the text of a scene file. Relative paths in the text count from the folder of
 * `path`, which need not exist; errors name it. The rest is as in portmet_scene_open. */
int portmet_scene_parse(portmet_scene **scene, const char *text, const char *path,
                        const char *weights);

/* Opens the scene of the name `name` that `portmetd serve` steps, on this host or another one, and
 * begins a run there, which is held at the initial state of the scene and between the steps that
 * this program asks for. It has the functions of a scene that is stepped here, the same arrays and
 * the same bits, but for these: the inputs are the live inputs of the scene, all of which must be
 * set before the first of them counts; a recording is made by the service, and ends with the run.
 * `name` is that of the scene; the session of the service, if it has one, follows after a colon.
 * `url` is the LCM provider; NULL: LCM's default, on this host alone. `key_file` holds the key of
 * the scene; NULL: it has none. `record` names a recording in the folder of the service; NULL:
 * none. `patience` is the time in s without an answer after which a call fails; 0: 10 s. A step
 * that waits for an input that nobody gives fails after the same time, and is not taken.
 * PORTMET_ENET: there is no route for multicast; PORTMET_ETIMEOUT: nobody answers; PORTMET_EUSAGE:
 * the patience is negative or NaN, or the service refuses, because a run of somebody else is under
 * way. Closing the scene ends the run. */
int portmet_scene_connect(portmet_scene **scene, const char *name, const char *url,
                          const char *key_file, const char *record, double patience);
void portmet_scene_close(portmet_scene *scene); /* NULL is allowed */

/* Compiles the models of a scene that was just opened, with the C compiler $CC or cc, to code that
 * makes steps faster and has the same bits. It is kept in the folder "portmet" of $XDG_CACHE_HOME,
 * by default ~/.cache, so that it is compiled once for these models, this compiler and this
 * processor. Fleets of the scene are compiled as well. The scene is then at step 0, and its arrays
 * are in other places: call it before you ask for them. PORTMET_EFILE: there is no compiler, or no
 * folder that belongs to this user alone; the scene is then as it was, at step 0. */
int portmet_scene_compile(portmet_scene *scene);

/* Takes `count` steps, 0 or more, and returns after the first failure. The failed step is not
 * taken: all arrays have the bits that they had before it, and so have all later steps. A recording
 * that has failed must be ended before the next step. */
int portmet_scene_step(portmet_scene *scene, int64_t count);

/* Takes a scene that was opened from the same files to where `from` is: state, step, ledger and
 * boundary inputs become those of `from`, and both go on with the same bits. A recording of `scene`
 * ends. PORTMET_EUSAGE: the scenes differ, or portmet_scene_connect has opened one of them. */
int portmet_scene_copy(portmet_scene *scene, portmet_scene *from);

/* Starts again at step 0 with an empty ledger, at the state z, which has the size and the order of
 * PORTMET_STATE, or at the initial state of the scene if `z` is NULL. A recording ends.
 * PORTMET_ENUMERIC: a number of `z`, or an energy, an entropy or a co-energy there, is not finite;
 * the run is as it was. */
int portmet_scene_restart(portmet_scene *scene, const double *z);

/* These functions are for scenes that portmet_scene_connect has opened; for others they fail with
 * PORTMET_EUSAGE. portmet_scene_set_state puts the state z, as in portmet_scene_restart, in place
 * of the present one: the run goes on from there with the next step. The jump of energy and
 * entropy is booked as coming from outside, so that the totals of the ledger stay.
 * portmet_scene_checkpoint keeps the present state and ledger in the folder of the service under
 * `name` (letters, digits and "._-"), and portmet_scene_restore takes this or a later run of the
 * scene back to it. PORTMET_EFILE: nothing is kept under this name, or not by this scene. */
int portmet_scene_set_state(portmet_scene *scene, const double *z);
int portmet_scene_checkpoint(portmet_scene *scene, const char *name);
int portmet_scene_restore(portmet_scene *scene, const char *name);

/* Ends the run of a scene that portmet_scene_connect has opened; portmet_scene_restart begins
 * another. Does nothing for a scene that is stepped here. */
int portmet_scene_stop(portmet_scene *scene);

/* Lets calls to a scene that portmet_scene_connect has opened return after `seconds` without an
 * answer, with PORTMET_EINTERRUPTED, so that the program can look at signals; with 0, as at first,
 * they do not. portmet_scene_wait goes on waiting, and returns what the call would have returned,
 * or PORTMET_EINTERRUPTED again; the arrays that the call was given must stay until then. Any other
 * call holds the run first. PORTMET_EUSAGE: the scene is stepped here. */
int portmet_scene_interrupt_after(portmet_scene *scene, double seconds);
int portmet_scene_wait(portmet_scene *scene);

/* Returns the number of steps taken, the time in s, the length of a step in s, and the number of
 * steps that the scene file asks for. */
int64_t portmet_scene_steps(const portmet_scene *scene);
double portmet_scene_time(const portmet_scene *scene);
double portmet_scene_dt(const portmet_scene *scene);
int64_t portmet_scene_planned(const portmet_scene *scene);

/* The arrays of a scene. They keep their place in memory until the scene is closed, and every step
 * updates them. S is the number of subsystems and P that of ports. */
enum portmet_array {
    PORTMET_STATE = 0,        /* [variables] of all subsystems, one after the other */
    PORTMET_ENERGY = 1,       /* [S] J */
    PORTMET_ENTROPY = 2,      /* [S] J/K */
    PORTMET_BULK_ENERGY = 3,  /* [S] W, the power of the subsystem's own term: 0 in the hard form */
    PORTMET_BULK_ENTROPY = 4, /* [S] W/K, the production of the subsystem's own term; like all means
                                 over the last step, NaN at step 0 */
    PORTMET_FLUX = 5,  /* [P][2][4] for the ends a and b: the energy flux in W and the entropy flux
                          in W/K, positive into the subsystem, then the gross flux of each, which
                          is the sum of the magnitudes of its terms; means over the last step */
    PORTMET_LEDGER = 6 /* [PORTMET_LEDGER_SIZE] see portmet_ledger */
};

/* The positions in the array PORTMET_LEDGER. The totals include what has left through boundary
 * inputs. Residuals are relative to the gross flux. */
enum portmet_ledger {
    PORTMET_FIRST_ENERGY = 0,     /* J, total at step 0 */
    PORTMET_TOTAL_ENERGY = 1,     /* J, total now */
    PORTMET_FIRST_ENTROPY = 2,    /* J/K, total at step 0 */
    PORTMET_TOTAL_ENTROPY = 3,    /* J/K, total now */
    PORTMET_ENERGY_DRIFT = 4,     /* J, largest difference of the total from that at step 0 */
    PORTMET_ENTROPY_FALL = 5,     /* J/K, largest fall of the total over one step */
    PORTMET_OUTSIDE_ENERGY = 6,   /* J, what has left through boundary inputs */
    PORTMET_OUTSIDE_ENTROPY = 7,  /* J/K, what has left through boundary inputs */
    PORTMET_ENERGY_RESIDUAL = 8,  /* largest residual of the first law in any step */
    PORTMET_ENTROPY_RESIDUAL = 9, /* most negative residual of the second law in any step */
    PORTMET_VIOLATIONS = 10,      /* steps with a residual beyond the scene's tolerances */
    PORTMET_LEDGER_SIZE = 11
};

/* Returns an array of the scene, which owns it, and its size in numbers (`size` may be NULL). NULL:
 * there is no such array. */
const double *portmet_scene_array(const portmet_scene *scene, int array, size_t *size);

/* Returns the array of the values of the boundary inputs, and its size in numbers (`size` may be
 * NULL). The caller writes to the array. A number replaces, from the next step on, the value that
 * the scene prescribes. NaN, with which the array is filled at first, leaves the scene's own value.
 * The scene owns the array. NULL: the scene has no boundary inputs. */
double *portmet_scene_inputs(portmet_scene *scene, size_t *size);

/* Computes what a scene shows to its neighbours at the present state. `coenergy` [variables] are
 * the co-energies dE/dz: velocities, forces, temperatures, pressures, voltages. Where a group is
 * given by its co-energy, it is that of the energy variable inside. `reaction` [R], unless it is
 * NULL, are the rates that all ports give to what the boundary inputs prescribe, at their present
 * values: the force of a pivot whose velocity is prescribed. Effort times reaction is a power into
 * the outside. R is the number of names of the kind PORTMET_REACTION. PORTMET_EUSAGE: the scene is
 * stepped elsewhere. */
int portmet_scene_efforts(portmet_scene *scene, double *coenergy, double *reaction);

/* The kinds of names that portmet_scene_name returns. */
enum portmet_kind {
    PORTMET_SUBSYSTEM = 0,      /* "upper" */
    PORTMET_VARIABLE = 1,       /* of PORTMET_STATE: "upper.q[0]" */
    PORTMET_VARIABLE_UNIT = 2,  /* "m" */
    PORTMET_PORT = 3,           /* "joint" */
    PORTMET_PORT_A = 4,         /* the subsystem or boundary input at end a of the port: "upper" */
    PORTMET_PORT_B = 5,         /* at end b */
    PORTMET_INPUT = 6,          /* of portmet_scene_inputs: "hand.f[0]", "hand.dE/df[0]",
                                   "hand.dS/df[0]" */
    PORTMET_INPUT_UNIT = 7,     /* "m", "J/(m)", "J/K/(m)" */
    PORTMET_REFERENCE = 8,      /* the file of the reference trajectory */
    PORTMET_SCENE = 9,          /* the name of the scene */
    PORTMET_COENERGY_NAME = 10, /* of portmet_scene_efforts: "upper.dE/dp[0]" */
    PORTMET_COENERGY_UNIT = 11, /* "m/s" */
    PORTMET_REACTION = 12,      /* "hand.df/dt[0]" */
    PORTMET_REACTION_UNIT = 13, /* "m/s" */
    PORTMET_WEIGHT = 14         /* a matrix of weights, with its shape: "upper.energy.skip[1][6]",
                                   "joint.constant.K[1][1]"; a positive constant is the logarithm */
};

/* Returns the name number `index`, from 0 on, which the scene owns. NULL: there are no more. */
const char *portmet_scene_name(const portmet_scene *scene, int kind, size_t index);

/* Records the present state and every later step in an HDF5 file. An earlier recording of this name
 * is replaced; any other file is refused. NULL ends the recording and completes the file; so does
 * closing the scene. */
int portmet_scene_record(portmet_scene *scene, const char *path);

/* Copies of one scene, which differ in their states and boundary inputs. Threads share them, and
 * every copy has the bits that a scene alone has with this state and these inputs, whatever the
 * numbers of copies and threads. There is no ledger: neither the guard `energy_drift` nor the
 * tolerances of both laws end a copy. One fleet belongs to one thread at a time.
 *
 *     portmet_fleet *fleet;
 *     portmet_fleet_open(&fleet, scene, 10000, 0);
 *     double *state = portmet_fleet_array(fleet, PORTMET_FLEET_STATE); // [10000][variables]
 *     state[0] += 0.1;
 *     portmet_fleet_step(fleet, 200);
 */
typedef struct portmet_fleet portmet_fleet;

/* Opens `count` copies of a scene, at its initial state. `threads` share them; 0: as many as there
 * are processors. The scene must stay open as long as the fleet, and may be stepped meanwhile. The
 * caller closes the fleet. PORTMET_EUSAGE: a number is out of range, or the scene is one that
 * portmet_scene_connect has opened. */
int portmet_fleet_open(portmet_fleet **fleet, const portmet_scene *scene, int64_t count,
                       int threads);
void portmet_fleet_close(portmet_fleet *fleet); /* NULL is allowed */

/* The arrays of a fleet of N copies. They keep their place in memory until it is closed. The caller
 * may write to all of them between two calls. S is the number of subsystems. */
enum portmet_fleet_arrays {
    PORTMET_FLEET_STATE = 0,   /* double [N][variables] */
    PORTMET_FLEET_INPUTS = 1,  /* double [N][inputs] as in portmet_scene_inputs; NULL: there are
                                  none */
    PORTMET_FLEET_ENERGY = 2,  /* double [N][S] J, after the last step */
    PORTMET_FLEET_ENTROPY = 3, /* double [N][S] J/K, after the last step */
    PORTMET_FLEET_STEPS = 4,   /* int64_t [N] steps taken, from which the time follows */
    PORTMET_FLEET_ENDED = 5    /* int [N] 0: the copy takes steps. A copy whose step has failed has
                                  the portmet_status of the failure, and the state before this step.
                                  The caller may write any number, by which the copy rests, and 0,
                                  by which it goes on. */
};

/* Returns an array of a fleet, which owns it. NULL: there is no such array. */
void *portmet_fleet_array(const portmet_fleet *fleet, int array);

/* Takes `count` steps, 0 or more, of every copy that has not ended. The inputs hold during all of
 * them. It returns 0 also if copies have ended; portmet_fleet_failure says in one line which is the
 * first of them in this call, and why: "copy 7: step 3: ...", "" if none has ended. With 0 steps
 * the energies become those of the states that the caller has written. */
int portmet_fleet_step(portmet_fleet *fleet, int64_t count);
const char *portmet_fleet_failure(const portmet_fleet *fleet);

/* portmet_fleet_save writes the copies copy [count], or the first `count` if `copy` is NULL, to
 * rows [count][portmet_fleet_row(fleet)], and portmet_fleet_restore reads them back, into the same
 * copies or others. A row holds all with which a copy goes on with the same bits, but not its
 * inputs; it begins with the state. PORTMET_EUSAGE: there is no such copy, or a row to be restored
 * has no whole numbers of steps and of `ended`; all copies are then as they were. */
size_t portmet_fleet_row(const portmet_fleet *fleet);
int portmet_fleet_save(portmet_fleet *fleet, int64_t count, const int64_t *copy, double *rows);
int portmet_fleet_restore(portmet_fleet *fleet, int64_t count, const int64_t *copy,
                          const double *rows);

/* Derivatives of rollouts. A rollout takes every copy, also those that have ended, from the states
 * start [N][variables] (NULL: the present ones) through `pieces` times `steps` steps, from the time
 * that `portmet_fleet_array` says. In each piece the inputs inputs [pieces][N][inputs] hold, NULL:
 * always those of the fleet. The fleet stays as it is. W is the number of weights: all numbers of
 * the matrices of PORTMET_WEIGHT, one after the other.
 *
 * portmet_fleet_vjp computes the gradient of the sum of `seed` times the states at the ends of all
 * pieces, both [pieces][N][variables], for each copy: by_start [N][variables], by_inputs
 * [pieces][N][inputs] and by_weights [N][W]; the last two may be NULL. An input that is NaN counts
 * as a shift of the scene's own value. portmet_fleet_jvp computes these states and their
 * derivatives d_states along directions d_start, d_inputs and d_weights, of the shapes above; NULL:
 * zero. A copy that leaves what its scene can be stepped from has derivatives that are not finite.
 *
 * PORTMET_ECONFIG: the scene's integrator is none of euler, heun, rk4 and rk6, or it has a
 * tolerance. PORTMET_EUSAGE: there are no steps. */
int portmet_fleet_vjp(portmet_fleet *fleet, int64_t pieces, int64_t steps, const double *start,
                      const double *inputs, const double *seed, double *by_start, double *by_inputs,
                      double *by_weights);
int portmet_fleet_jvp(portmet_fleet *fleet, int64_t pieces, int64_t steps, const double *start,
                      const double *inputs, const double *d_start, const double *d_inputs,
                      const double *d_weights, double *states, double *d_states);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif

#endif
