// portmetd test: runs a scene as an assembly of processes in many ways, among them ways in which
// processes die and messages get lost, and compares every recording with that of one process. Each
// run is a child of this process that executes `run` on a changed text of the scene.
#include <arpa/inet.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <net/if.h>
#include <net/route.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/prepare.h"
#include "base/options.h"
#include "base/progress.h"
#include "base/rng.h"
#include "base/subcommand.h"
#include "library/local_run.h"
#include "lockstep/coordinator.h"
#include "lockstep/health.h"
#include "study/recordings.h"
#include "study/rollout.h"

#define MOST_STEPS 48    // of a run
#define LEAST_STEPS 8    // so that three holds lie within it
#define MOST_CPU 1.0     // s, of the run in one process
#define MOST_EACH 12     // subsystems with a process each; more share BLOCKS processes
#define BLOCKS 8         // processes of a larger scene
#define DEADLINE 120.0   // s until a run that has not ended counts as hanging
#define STOPPED 0.6      // s for which a process is stopped
#define GRACE 5.0        // s for the processes of a run to end
#define LOOK 0.005       // s between two looks at a run
#define MOST_ROUNDS 2000 // exchanges of a run
#define CHECKPOINT 4     // steps between two checkpoints
#define UNUSED 1e-9      // share of the largest gross flux below which a port carries nothing
#define PATH_SIZE 128    // bytes of a path in the folder of a test
#define NO_PROGRAM 127   // exit code of a child that could not start mpirun
#define KEY_SIZE 32      // bytes
#define LINE 512         // bytes of a line of results
#define BUDGET 60.0      // s, of a bench by default
#define SPAN 1.0         // s of CPU time of a run in this process
#define SECONDS 4       // messages, one a second, of which all but the first tell what a step costs
#define LONG 1000000000 // steps of a run that is measured, more than it can take

// Which subsystems share a process; OWN: as the scene says.
typedef enum cut { EACH, TOGETHER, OWN, HALVES, EVERY_OTHER } cut;

// Each of these is done to a run while it goes on. All but SMOOTH hold it at steps.
typedef enum disturbance { SMOOTH, KILLS, KILLS_COORDINATOR, STOPS, CONTINUES } disturbance;

typedef struct trial {
    const char *name;
    cut cut;
    const char *faults; // options of the URL
    disturbance disturbance;
    int window;
    int share; // of the steps that it takes: one in so many; 0: all
    bool in_process, sealed, ranks, other;
} trial;

static const trial trials[] = {
    {.name = "in one process", .in_process = true},
    {.name = "a process each"},
    {.name = "a process each, window of 4", .window = 4},
    {.name = "all in one process over LCM", .cut = TOGETHER},
    {.name = "the scene's own processes", .cut = OWN},
    {.name = "two processes, two halves", .cut = HALVES},
    {.name = "two processes, every other subsystem", .cut = EVERY_OTHER},
    {.name = "sealed messages", .sealed = true},
    {.name = "over MPI", .ranks = true},
    {.name = "1 % of all messages lost", .faults = "&lose=0.01"},
    {.name = "20 % of all messages lost", .faults = "&lose=0.2", .share = 8},
    {.name = "messages late, out of order and twice", .faults = "&mix=0.3"},
    {.name = "each process killed at three times", .disturbance = KILLS, .faults = "&mix=0.3"},
    {.name = "the coordinator killed at three times", .disturbance = KILLS_COORDINATOR},
    {.name = "a process stopped for a while", .disturbance = STOPS},
    {.name = "killed as a whole, continued from checkpoints", .disturbance = CONTINUES},
    {.name = "the last process with the weights of --other", .cut = OWN, .other = true},
};
enum { NTRIAL = sizeof trials / sizeof *trials, NHOLD = 3 };

typedef struct assembly {
    const pm_run_options *options;
    pm_setup setup; // of the scene as it is
    char *text;     // of the scene with the steps of a test
    char *mean;     // of the scene with the inputs that lie in a table at their means
    char folder[64];
    int steps;                 // of each run
    int shown;                 // steps in this process, for the table of ports
    int count, failed;         // runs
    char first[LINE];          // failure
    FILE *json;                // NULL: tables are printed
    const pm_run_options *run; // of the trial that is disturbed
} assembly;

// --- a private network ---

static pm_status write_file(const char *path, const void *data, size_t size, mode_t mode) {
    const int file = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, mode);
    const bool written = file >= 0 && write(file, data, size) == (ssize_t)size;
    const int error = errno;
    if (file >= 0) {
        close(file);
    }
    return written ? PM_OK : pm_fail(PM_EFILE, "%s: %s", path, strerror(error));
}

// Moves this process, and so all that it starts, to a network of its own in which messages travel
// over the loopback device. Without the rights of root it takes a user namespace, too. PM_ENET.
static pm_status enter_private_network(void) {
    char map[64];
    const uid_t user = getuid();
    const gid_t group = getgid();
    if (unshare(CLONE_NEWNET) != 0) {
        if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) {
            return pm_fail(PM_ENET,
                           "test: a private network is not allowed here (%s): run as "
                           "root, or with --here in the network that is there",
                           strerror(errno));
        }
        snprintf(map, sizeof map, "%u %u 1", (unsigned)user, (unsigned)user);
        PM_TRY(write_file("/proc/self/uid_map", map, strlen(map), 0));
        PM_TRY(write_file("/proc/self/setgroups", "deny", 4, 0));
        snprintf(map, sizeof map, "%u %u 1", (unsigned)group, (unsigned)group);
        PM_TRY(write_file("/proc/self/gid_map", map, strlen(map), 0));
    }
    const int file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    struct ifreq device = {.ifr_name = "lo", .ifr_flags = IFF_UP | IFF_RUNNING | IFF_MULTICAST};
    struct sockaddr_in to = {.sin_family = AF_INET}, mask = to;
    struct rtentry route = {.rt_flags = RTF_UP, .rt_dev = device.ifr_name};
    to.sin_addr.s_addr = htonl(0xe0000000); // 224.0.0.0/4
    mask.sin_addr.s_addr = htonl(0xf0000000);
    memcpy(&route.rt_dst, &to, sizeof to);
    memcpy(&route.rt_genmask, &mask, sizeof mask);
    const bool good =
        file >= 0 && ioctl(file, SIOCSIFFLAGS, &device) == 0 && ioctl(file, SIOCADDRT, &route) == 0;
    const int error = errno;
    if (file >= 0) {
        close(file);
    }
    return good ? PM_OK
                : pm_fail(PM_ENET,
                          "test: the private network: %s; --here uses the network that "
                          "is there",
                          strerror(error));
}

// --- a run ---

static const char *in_folder(const assembly *a, char *path, const char *name) {
    snprintf(path, PATH_SIZE, "%s/%s", a->folder, name);
    return path;
}

static void pause_for(double seconds) {
    nanosleep(&(struct timespec){.tv_nsec = (long)(1e9 * seconds)}, NULL);
}

// Divides the subsystems among `count` processes: consecutive ones, or every other one.
static pm_status put_processes(const pm_scene *scene, bool every_other, int count, char **text) {
    const int n = scene->physics.nsubsystem;
    char *value = NULL;
    size_t size;
    FILE *file = open_memstream(&value, &size);
    PM_TRY(pm_allocated(file, "a cut"));
    for (int k = 0; k < count; ++k) {
        fprintf(file, "%sprocess_%d: [", k == 0 ? "{" : "], ", k);
        const char *before = "";
        for (int i = 0; i < n; ++i) {
            if ((every_other ? i % count : (int)((long)i * count / n)) == k) {
                fprintf(file, "%s%s", before, scene->physics.subsystem[i].name);
                before = ", ";
            }
        }
    }
    fputs("]}", file);
    const pm_status status = fclose(file) == 0 ? pm_scene_text_put(text, "processes", value)
                                               : pm_fail(PM_ENOMEM, "out of memory for a cut");
    free(value);
    return status;
}

// Makes the text of a trial, which the caller frees.
static pm_status make_text(const assembly *a, const trial *t, char **text) {
    const pm_scene *scene = a->setup.scene;
    const int n = scene->physics.nsubsystem;
    const int count = t->cut == TOGETHER ? 1 : t->cut != EACH ? 2 : n > MOST_EACH ? BLOCKS : n;
    char line[LINE], path[PATH_SIZE];
    *text = strdup(a->text);
    PM_TRY(pm_allocated(*text, "a scene"));
    PM_TRY(t->cut == OWN ? PM_OK : put_processes(scene, t->cut == EVERY_OTHER, count, text));
    snprintf(line, sizeof line, "{window: %d, patience: %g, checkpoint: %d}",
             t->window > 0 ? t->window : scene->network.window, DEADLINE, CHECKPOINT);
    PM_TRY(pm_scene_text_put(text, "lockstep", line));
    return t->sealed ? pm_scene_text_put(text, "key_file", in_folder(a, path, "key")) : PM_OK;
}

// Starts a child that executes `command`, with its words in FOLDER/NAME.out and FOLDER/NAME.err. A
// job of MPI is started as a program instead.
static pid_t start(const assembly *a, const pm_command *command, const pm_run_options *options,
                   char *const *program, const char *name) {
    fflush(NULL);
    const pid_t parent = getpid(), pid = fork();
    if (pid != 0) {
        return pid;
    }
    static const char *const ends[] = {"out", "err"};
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    bool good = getppid() == parent;
    for (int i = 0; i < 2; ++i) {
        char path[PATH_SIZE];
        snprintf(path, sizeof path, "%s/%s.%s", a->folder, name, ends[i]);
        const int file = open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
        good = good && file >= 0 && dup2(file, i + 1) == i + 1;
    }
    if (good && program != NULL) {
        setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
        setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);
        setenv("OMPI_MCA_rmaps_base_oversubscribe", "1", 1);
        execvp(program[0], program);
        _exit(NO_PROGRAM);
    }
    _exit(good ? pm_subcommand_end("portmetd", command->execute(options)) : PM_EFILE);
}

// Counts how often a text stands in FOLDER/NAME. `last` (NULL: not wanted) receives the last line
// with it.
static int count_in(const assembly *a, const char *name, const char *text, char *last) {
    char path[PATH_SIZE], line[LINE];
    FILE *file = fopen(in_folder(a, path, name), "r");
    int count = 0;
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        const bool has = strstr(line, text) != NULL;
        count += has;
        line[strcspn(line, "\n")] = '\0';
        if (last != NULL && has && line[0] != '\0') {
            snprintf(last, LINE, "%s", line);
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return count;
}

// Waits until a text stands as many times in the errors of the run; false if the run ends before,
// or the user interrupts.
static bool await(const assembly *a, pid_t run, const char *text, int count) {
    const double end = pm_clock() + DEADLINE;
    while (count_in(a, "run.err", text, NULL) < count) {
        siginfo_t info = {0};
        const bool ended =
            waitid(P_PID, (id_t)run, &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == run;
        if (ended || *a->options->stop || pm_clock() > end) {
            return false;
        }
        pause_for(LOOK);
    }
    return true;
}

static bool await_held(const assembly *a, pid_t run, int step) {
    char text[64];
    snprintf(text, sizeof text, "held after step %d\n", step);
    return await(a, run, text, 1);
}

// Lets the run complete as many steps.
static void go_on(const assembly *a, int step) {
    pm_run_options options = *a->run;
    options.steps = step;
    options.quiet = true;
    (void)pm_command_resume.execute(&options);
}

// Sends a signal to the children of a run: to all, or to the coordinator, or to the nodes. Returns
// how many there are; the first `most` get the signal.
static int send_signal(pid_t run, bool coordinator, int most, int number) {
    int count = 0;
    for (int attempt = 0; attempt < 400 && count == 0; ++attempt) {
        char path[64], name[64] = "";
        DIR *folder = opendir("/proc");
        const struct dirent *entry;
        while (folder != NULL && (entry = readdir(folder)) != NULL) {
            int parent = 0;
            snprintf(path, sizeof path, "/proc/%.20s/stat", entry->d_name);
            FILE *file = atoi(entry->d_name) > 0 ? fopen(path, "r") : NULL;
            const bool read =
                file != NULL && fscanf(file, "%*d (%63[^)]) %*c %d", name, &parent) == 2;
            if (file != NULL) {
                fclose(file);
            }
            if (read && parent == run && coordinator == (strcmp(name, "coordinator") == 0) &&
                count++ < most) {
                kill(atoi(entry->d_name), number);
            }
        }
        if (folder != NULL) {
            closedir(folder);
        }
        if (count == 0) {
            pause_for(LOOK);
        }
    }
    return count;
}

// Disturbs a run that is held at its start. `why` [LINE] says what is wrong if something is.
static void disturb(const assembly *a, disturbance how, pid_t run, char *why) {
    int hold[NHOLD + 1], deaths = 0;
    for (int k = 0; k <= NHOLD; ++k) {
        hold[k] = a->steps * (k + 1) / (NHOLD + 1);
    }
    go_on(a, hold[0]);
    if (how == CONTINUES || how == STOPS) {
        const bool held = await_held(a, run, hold[0]);
        if (held && how == CONTINUES) {
            kill(run, SIGKILL);
            return;
        }
        if (held) {
            send_signal(run, false, 1, SIGSTOP);
            go_on(a, hold[1]);
            pause_for(STOPPED);
            if (count_in(a, "run.err", "held after step", NULL) > 2) {
                snprintf(why, LINE, "the run went on without a process");
            }
            send_signal(run, false, 1, SIGCONT);
        }
        go_on(a, a->steps);
        return;
    }
    // At every other hold processes die while the run is held, and else on the way to the next.
    for (int k = 0; k < NHOLD && await_held(a, run, hold[k]); ++k) {
        if (k % 2 == 1) {
            go_on(a, hold[k + 1]);
        }
        deaths += send_signal(run, how == KILLS_COORDINATOR, MOST_EACH, SIGKILL);
        if (!await(a, run, "killed by signal 9 (Killed), started again", deaths)) {
            return;
        }
        if (k % 2 == 0) {
            go_on(a, hold[k + 1]);
        }
    }
    go_on(a, a->steps);
}

// Waits for a child and returns its exit code; -1: a signal has ended it, or it hangs.
static int wait_for(const assembly *a, pid_t pid, double grace) {
    int end = 0;
    double deadline = pm_clock() + grace;
    for (bool told = false; waitpid(pid, &end, WNOHANG) == 0; pause_for(LOOK)) {
        if (*a->options->stop || pm_clock() > deadline) {
            kill(pid, told && pm_clock() > deadline ? SIGKILL : SIGTERM);
            deadline = told ? deadline : pm_clock() + GRACE;
            told = true;
        }
    }
    return WIFEXITED(end) ? WEXITSTATUS(end) : -1;
}

// Executes a trial. `why` [LINE] becomes what is wrong, or stays empty; `skipped` the reason for
// which it cannot be made.
static pm_status execute_trial(assembly *a, const trial *t, char *why, const char **skipped) {
    const pm_scene *scene = a->setup.scene;
    const int n = scene->physics.nsubsystem;
    const bool keeps = t->disturbance > SMOOTH && t->disturbance != STOPS;
    char record[PATH_SIZE], plain[PATH_SIZE], kept[PATH_SIZE], url[LINE], program[PATH_MAX],
        steps[16], ranks[16], *text = NULL;
    const char *address = pm_connect_url(scene, a->options->url);
    address = pm_transport_has_ranks(address) ? "udpm://239.255.76.67:7667?ttl=0" : address;
    snprintf(url, sizeof url, "%s%s%s", address,
             t->faults != NULL && strchr(address, '?') == NULL ? "?ttl=0" : "",
             t->faults == NULL ? "" : t->faults);
    *skipped = t->other && a->options->other == NULL                        ? ""
               : t->cut == OWN && !t->other && scene->network.nprocess == n ? "" // a process each
               : keeps && pm_physics_is_adaptive(&scene->physics)
                   ? "a scene with a tolerance keeps no checkpoints"
               : keeps && scene->network.nlive > 0     ? "live inputs do not come again"
               : t->sealed && scene->network.nlive > 0 ? "a scene with live inputs has no key"
               : t->window > 1 && pm_physics_is_adaptive(&scene->physics)
                   ? "a scene with a tolerance has a window of 1"
               : t->window > 1 && scene->network.nlive > 0
                   ? "a scene with live inputs has a window of 1"
               : t->cut > OWN && n < 3       ? "there are too few subsystems"
               : t->cut == TOGETHER && n < 2 ? "there is one subsystem"
               : t->ranks && (scene->run.recorded != NULL || scene->run.record_every > 1)
                   ? "the scene records a part of its states"
               : t->ranks && scene->network.nprocess > MOST_EACH   ? "too many processes"
               : t->ranks && pm_transport_check("mpi://") != PM_OK ? "built without MPI"
                                                                   : NULL;
    if (*skipped != NULL) {
        return PM_OK;
    }
    pm_status status = make_text(a, t, &text);
    PM_TRY_DONE(status);
    pm_run_options options = {.scene = scene->path,
                              .text = text,
                              .weights = a->options->weights,
                              .replay = a->options->replay,
                              .steps = t->share > 0 ? (a->steps + t->share - 1) / t->share : 0,
                              .url = url,
                              .overwrite = true,
                              .in_process = t->in_process,
                              .log = {.program = "portmetd", .part = "run"},
                              .stop = a->options->stop};
    // Each has a file of its own, as this process does not let its children replace what it reads.
    snprintf(record, sizeof record, "%s/%s%td.h5", a->folder, t->in_process ? "plain" : "run",
             t - trials);
    options.record = record;
    options.held = t->disturbance > SMOOTH;
    options.checkpoint = keeps ? in_folder(a, kept, "checkpoints") : NULL;
    unlink(in_folder(a, plain, "run.err"));
    unlink(in_folder(a, plain, "run.out"));
    int code;
    if (t->other) {
        // The coordinator and each node start as on hosts of their own.
        const pm_network *network = &scene->network;
        pm_arena arena = {0};
        pid_t *node = pm_arena_array(&arena, (size_t)network->nprocess, sizeof *node);
        options.session = pm_lockstep_session();
        for (int i = 0; i < network->nprocess && node != NULL; ++i) {
            pm_run_options own = options;
            own.name = network->process[i].name;
            own.weights = i == network->nprocess - 1 ? a->options->other : options.weights;
            own.record = NULL;
            node[i] = start(a, &pm_command_node, &own, NULL, "node");
        }
        code = wait_for(a, start(a, &pm_command_coordinator, &options, NULL, "run"), DEADLINE);
        for (int i = 0; i < network->nprocess && node != NULL; ++i) {
            if (code != 0) {
                kill(node[i], SIGTERM);
            }
            wait_for(a, node[i], GRACE);
        }
        pm_arena_free(&arena);
    } else if (t->ranks) {
        const ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
        program[length > 0 ? length : 0] = '\0';
        snprintf(steps, sizeof steps, "%d", a->steps);
        snprintf(ranks, sizeof ranks, "%d", scene->network.nprocess + 1);
        char *argv[20] = {
            "mpirun", "-n",      ranks, program,    "run",  (char *)scene->path, "--url",
            "mpi://", "--steps", steps, "--record", record, "--overwrite"};
        int nword = 13;
        if (options.weights != NULL) {
            argv[nword++] = "--weights";
            argv[nword++] = (char *)options.weights;
        }
        if (options.replay != NULL) {
            argv[nword++] = "--replay";
            argv[nword++] = (char *)options.replay;
        }
        code = wait_for(a, start(a, NULL, NULL, argv, "run"), DEADLINE);
    } else {
        const pid_t run = start(a, &pm_command_run, &options, NULL, "run");
        if (t->disturbance > SMOOTH) {
            a->run = &options;
            disturb(a, t->disturbance, run, why);
        }
        code = wait_for(a, run, DEADLINE);
        if (t->disturbance == CONTINUES && code == -1) {
            options.held = false;
            code = wait_for(a, start(a, &pm_command_run, &options, NULL, "run"), DEADLINE);
        }
    }
    if (t->ranks && code == NO_PROGRAM) {
        *skipped = "mpirun is missing";
    } else if (code != 0) {
        char last[LINE] = "no word";
        count_in(a, "run.err", t->ranks ? "portmetd: " : "", last); // mpirun has the last word
        snprintf(why, LINE, "exit code %d: %.400s", code, last);
    } else if (!t->in_process && why[0] == '\0') {
        PM_TRY_DONE(pm_recordings_compare(in_folder(a, plain, "plain0.h5"), record, t->share > 0,
                                          why, LINE));
    }
done:
    free(text);
    return status;
}

// --- in this process ---

// Sums over a run of what crosses a port.
typedef struct crossing {
    double power, production; // W into end b, W/K, over all steps
    double gross, residual;   // W, the largest; relative, the largest
} crossing;

// Runs the scene in this process for as many steps as a test needs, and sums up its ports.
static pm_status run_here(assembly *a, crossing *port, pm_ledger *ledger) {
    const pm_physics *physics = &a->setup.scene->physics;
    const int rounds = physics->substeps * pm_integrator_most_rounds(physics->integrator);
    const int most = a->setup.scene->run.steps; // --steps in place of the scene's
    a->steps = MOST_ROUNDS / rounds < LEAST_STEPS  ? LEAST_STEPS
               : MOST_ROUNDS / rounds > MOST_STEPS ? MOST_STEPS
                                                   : MOST_ROUNDS / rounds;
    pm_local_run run = {0};
    pm_status status = pm_local_run_open(&run, &a->setup, PM_LOCAL_SAMPLES);
    const double started = pm_clock();
    while (status == PM_OK && run.sample.step < most) {
        status =
            *a->options->stop ? pm_fail(PM_EINTERRUPTED, "interrupted") : pm_local_run_step(&run);
        for (int i = 0; i < physics->nport && status == PM_OK; ++i) {
            const pm_flux *end = run.sample.flux[i];
            const double gross = end[0].energy_gross + end[1].energy_gross;
            const double lost = fabs(end[0].energy + end[1].energy);
            port[i].power += end[1].energy;
            port[i].production += end[0].entropy + end[1].entropy;
            port[i].gross = fmax(port[i].gross, gross);
            port[i].residual = fmax(port[i].residual, gross > 0 ? lost / gross : 0);
        }
        if (run.sample.step >= a->steps && a->options->steps == 0 &&
            pm_clock() - started > MOST_CPU) {
            break;
        }
    }
    a->shown = (int)run.sample.step;
    a->steps = a->shown < a->steps || a->options->steps > 0 ? a->shown : a->steps;
    *ledger = run.ledger;
    pm_local_run_close(&run);
    return status;
}

static void print_ports(assembly *a, const crossing *port, const pm_ledger *ledger) {
    const pm_scene *scene = a->setup.scene;
    double largest = 0;
    for (int i = 0; i < scene->physics.nport; ++i) {
        largest = fmax(largest, port[i].gross);
    }
    if (a->json == NULL && scene->physics.nport > 0) {
        printf("\n%-20s %-28s %12s %14s %9s\n", "Port", "mean power goes", "W", "produces, W/K",
               "residual");
    }
    for (int i = 0; i < scene->physics.nport; ++i) {
        const pm_scene_port *p = &scene->physics.port[i];
        const crossing *c = &port[i];
        const int from = c->power < 0;
        const bool used = c->gross > UNUSED * largest;
        const double power = fabs(c->power) / a->shown, production = c->production / a->shown;
        char way[2 * PM_MAX_NAME + 16];
        snprintf(way, sizeof way, "%s to %s", pm_scene_end_name(scene, p, from),
                 pm_scene_end_name(scene, p, 1 - from));
        if (a->json != NULL) {
            fprintf(a->json,
                    "%s{\"port\":\"%s\",\"from\":\"%s\",\"to\":\"%s\",\"power\":%.9g,"
                    "\"production\":%.9g,\"residual\":%.3g,\"used\":%s}",
                    i == 0 ? "],\"ports\":[" : ",", p->name, pm_scene_end_name(scene, p, from),
                    pm_scene_end_name(scene, p, 1 - from), power, production, c->residual,
                    used ? "true" : "false");
        } else if (i < PM_SCENE_LISTED) {
            printf("%-20s %-28s %12.5g %+14.5g %9.1e%s\n", p->name, way, power, production,
                   c->residual, used ? "" : "  carries nothing");
        } else if (i == PM_SCENE_LISTED) {
            printf("and %d more\n", scene->physics.nport - i);
        }
    }
    if (a->json == NULL) {
        printf("\n%d step%s in this process: largest residual of the energy %.1e, of the entropy "
               "%.1e; steps in violation: %ld\n",
               a->shown, a->shown == 1 ? "" : "s", ledger->worst_energy, ledger->worst_entropy,
               ledger->violations);
    }
}

// --- what processes cost ---

typedef struct cost_meter {
    portmet_health_t health; // the last message of a run that has taken steps
    int count;
    double rate, cpu; // sums over all messages but the first: steps in a second, CPU time of all
                      // nodes in a second
} cost_meter;

static void on_health(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    cost_meter *l = context;
    if (pm_health_decode(&l->health, data, size) != PM_KEEP || l->health.rate <= 0 ||
        l->count++ == 0) {
        return;
    }
    l->rate += l->health.rate;
    for (int i = 0; i < l->health.nprocess; ++i) {
        l->cpu += l->health.cpu[i];
    }
}

// Runs the scene `text` over LCM for some seconds, and measures its cost. `who` [LINE] receives a
// text that says which process waits for which, or "" if the run ended before it reported that.
static pm_status measure_cut(assembly *a, const char *text, cost_meter *l, char *who) {
    pm_transport *transport = NULL;
    pm_scene *scene = NULL;
    pm_arena arena = {0};
    char path[PATH_SIZE], channel[PM_CHANNEL_SIZE], last[LINE] = "no word";
    const double end = pm_clock() + DEADLINE;
    pm_run_options options = {.scene = a->setup.scene->path,
                              .text = text,
                              .weights = a->options->weights,
                              .steps = LONG,
                              .log = {.program = "portmetd", .part = "run"},
                              .stop = a->options->stop};
    pid_t run = 0;
    siginfo_t info = {0};
    pm_status status;
    *l = (cost_meter){0};
    PM_TRY_DONE(pm_scene_parse(&scene, text, a->setup.scene->path));
    options.url = pm_connect_url(scene, NULL);
    l->health.nprocess = scene->network.nprocess;
    PM_TRY_DONE(pm_health_alloc(&l->health, &arena));
    PM_TRY_DONE(pm_connect_open(&transport, scene, options.url, "bench", &options.log));
    PM_TRY_DONE(pm_channel_scene(channel, scene->name, "HEALTH"));
    PM_TRY_DONE(pm_transport_subscribe(transport, channel, on_health, l));
    unlink(in_folder(a, path, "run.err"));
    run = start(a, &pm_command_run, &options, NULL, "run");
    while (l->count < SECONDS && info.si_pid == 0 && pm_clock() < end && !*a->options->stop) {
        PM_TRY_DONE(pm_transport_wait(transport, LOOK, NULL));
        waitid(P_PID, (id_t)run, &info, WEXITED | WNOHANG | WNOWAIT);
    }
    const portmet_health_t *h = &l->health;
    double most = 0;
    for (int i = 0; i < h->nprocess && l->count > 0; ++i) {
        if (h->waits_part[i] > most) {
            most = h->waits_part[i];
            snprintf(who, LINE, "%s waits for %s %.0f %%", pm_health_name(scene, i),
                     pm_health_name(scene, h->waits_for[i]), 100 * most);
        }
    }
    if (l->count > 0 && h->blocker != PM_HEALTH_NOBODY) {
        snprintf(who, LINE, "all others wait for %s", pm_health_name(scene, h->blocker));
    }
    if (info.si_pid != 0) { // nothing but a failure or a guard ends it so soon
        count_in(a, "run.err", "", last);
        status = pm_fail(PM_EBROKEN, "bench: the run has ended: %.400s", last);
    }
done:
    if (run > 0) {
        kill(run, SIGTERM);
        wait_for(a, run, GRACE);
    }
    pm_transport_close(transport);
    pm_arena_free(&arena);
    pm_scene_free(scene);
    return status;
}

// Puts a cut into `count` processes: by cost where the program can, else of consecutive subsystems.
static pm_status put_cut(const pm_scene *scene, int count, int window, char **text) {
    char value[128];
    const int n = scene->physics.nsubsystem;
    pm_scene *cut_by_cost = NULL;
    snprintf(value, sizeof value, "{window: %d, patience: %g, checkpoint: %d}", window,
             scene->network.patience, scene->network.checkpoint);
    PM_TRY(pm_scene_text_put(text, "lockstep", value));
    if (count == n) {
        return pm_scene_text_put(text, "processes", NULL);
    }
    snprintf(value, sizeof value, "{auto: %d}", count);
    PM_TRY(pm_scene_text_put(text, "processes", value));
    const bool able = count > 1 && pm_scene_parse(&cut_by_cost, *text, scene->path) == PM_OK;
    pm_scene_free(cut_by_cost);
    return able ? PM_OK : put_processes(scene, false, count, text);
}

// Measures cuts and windows, and prints a table and advice.
static pm_status bench_processes(assembly *a) {
    static const int windows[] = {1, 4, 16, 64};
    enum { NWINDOW = sizeof windows / sizeof *windows, NCUT = 3 };
    const pm_run_options *options = a->options;
    const pm_scene *scene = a->setup.scene;
    const int n = scene->physics.nsubsystem, cores = (int)sysconf(_SC_NPROCESSORS_ONLN);
    const int count[NCUT] = {1, cores < n ? cores : n, n > MOST_EACH ? BLOCKS : n};
    const pm_start start = {.trajectory =
                                a->setup.reference == NULL ? -1 : scene->run.reference_trajectory,
                            .z = a->setup.initial};
    const pm_rollout_spec spec = {.stepping = {scene->physics.integrator, scene->physics.substeps,
                                               scene->physics.tolerance, scene->physics.dt, LONG},
                                  .factor = 1,
                                  .seconds = SPAN};
    pm_rollout_result here;
    const double end = pm_clock() + (options->budget > 0 ? options->budget : BUDGET);
    double best = INFINITY;
    int advice[2] = {0, 0};
    pm_status status = PM_OK;
    pm_rollout_run(&a->setup, &start, &spec, NULL, &here);
    PM_TRY(here.steps > 0 ? PM_OK : pm_fail(here.status, "bench: %s", here.why));
    const double own = here.seconds / (double)here.steps;
    if (a->json != NULL) {
        fprintf(a->json, "{\"scene\":\"%s\",\"cores\":%d,\"plain\":%.6g,\"cuts\":[", scene->name,
                cores, own);
    } else {
        printf("%s: %d subsystem%s, %d cores; without LCM a step takes %.4g ms\n\n%9s %6s %10s "
               "%10s   %s\n",
               scene->name, n, n == 1 ? "" : "s", cores, 1e3 * own, "processes", "window",
               "ms a step", "CPU, ms", "");
    }
    int rows = 0, left = 0;
    for (int k = 0; k < NCUT * NWINDOW && status == PM_OK; ++k) {
        const int row = k / NWINDOW, window = windows[k % NWINDOW];
        char who[LINE] = "";
        cost_meter l;
        if ((row > 0 && count[row] == count[row - 1]) ||
            (window > 1 && pm_physics_is_adaptive(&scene->physics))) {
            continue;
        }
        if (rows > 0 && pm_clock() > end) {
            left += 1;
            continue;
        }
        char *text = strdup(a->mean);
        status = pm_allocated(text, "a scene");
        status = status == PM_OK ? put_cut(scene, count[row], window, &text) : status;
        status = status == PM_OK ? measure_cut(a, text, &l, who) : status;
        free(text);
        if (status != PM_OK || l.rate == 0) {
            continue;
        }
        const double seconds = (l.count - 1) / l.rate, cpu = l.cpu / l.rate;
        if (seconds < best) {
            best = seconds;
            advice[0] = count[row];
            advice[1] = window;
        }
        if (a->json != NULL) {
            fprintf(a->json,
                    "%s{\"processes\":%d,\"window\":%d,\"seconds\":%.6g,\"cpu\":%.6g,"
                    "\"waits\":\"%s\"}",
                    rows == 0 ? "" : ",", count[row], window, seconds, cpu, who);
        } else {
            printf("%9d %6d %10.4g %10.4g   %s\n", count[row], window, 1e3 * seconds, 1e3 * cpu,
                   who);
            fflush(stdout);
        }
        rows += 1;
    }
    if (a->json != NULL) {
        fprintf(a->json, "]}\n");
    } else if (left > 0) {
        printf("\nSettings left out, since they need a larger --budget: %d\n", left);
    }
    PM_TRY(status);
    PM_TRY(*options->stop ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK);
    PM_TRY(rows > 0 ? PM_OK : pm_fail(PM_EBROKEN, "bench: no run has told what its steps cost"));
    if (a->json == NULL) {
        printf("\nTake %d process%s and a window of %d: %.4g ms a step.\n", advice[0],
               advice[0] == 1 ? "" : "es", advice[1], 1e3 * best);
    }
    if (options->write != NULL) {
        PM_TRY(put_cut(scene, advice[0], advice[1], &a->text));
        PM_TRY(pm_scene_text_write(a->text, options->write, options->weights));
    }
    return PM_OK;
}

// --- the command ---

static pm_status make_trials(assembly *a) {
    unsigned char key[KEY_SIZE];
    char path[PATH_SIZE];
    pm_rng rng;
    pm_progress progress;
    pm_rng_init(&rng, (uint64_t)getpid(), 0);
    for (int i = 0; i < KEY_SIZE; ++i) {
        key[i] = (unsigned char)pm_rng_bits(&rng);
    }
    PM_TRY(write_file(in_folder(a, path, "key"), key, sizeof key, 0600));
    if (a->json == NULL) {
        printf("%s: %d step%s of %g s, %s with %d substep%s; subsystems: %d, ports: %d\n\n",
               a->setup.scene->name, a->steps, a->steps == 1 ? "" : "s", a->setup.scene->physics.dt,
               a->setup.scene->physics.integrator->name, a->setup.scene->physics.substeps,
               a->setup.scene->physics.substeps == 1 ? "" : "s", a->setup.scene->physics.nsubsystem,
               a->setup.scene->physics.nport);
    }
    pm_progress_init(&progress, "test", NTRIAL);
    pm_status status = PM_OK;
    for (int i = 0; i < NTRIAL && status == PM_OK; ++i) {
        char why[LINE] = "";
        const char *skipped = NULL;
        const double started = pm_clock();
        const trial *t = &trials[i];
        pm_progress_update(&progress, i, t->name);
        status = execute_trial(a, t, why, &skipped);
        const double seconds = pm_clock() - started;
        if (*a->options->stop) {
            status = pm_fail(PM_EINTERRUPTED, "interrupted");
        }
        if (status != PM_OK || (skipped != NULL && skipped[0] == '\0')) {
            continue;
        }
        const char *result = skipped != NULL  ? skipped
                             : why[0] != '\0' ? why
                             : t->in_process  ? "what all others must be like"
                                              : "the same bits";
        if (skipped == NULL) {
            a->count += 1;
            a->failed += why[0] != '\0';
            if (why[0] != '\0' && a->first[0] == '\0') {
                snprintf(a->first, sizeof a->first, "%s: %.400s", t->name, why);
            }
        }
        if (a->json != NULL) {
            char quoted[2 * LINE];
            pm_json_quote(quoted, sizeof quoted, result);
            fprintf(a->json, "%s{\"run\":\"%s\",\"%s\":%s,\"seconds\":%.3f}",
                    t == trials ? "{\"runs\":[" : ",", t->name,
                    skipped != NULL  ? "skipped"
                    : why[0] != '\0' ? "failure"
                                     : "result",
                    quoted, seconds);
        } else {
            printf("  %-48s %6.2f s   %s%s\n", t->name, seconds, skipped != NULL ? "skipped: " : "",
                   result);
            fflush(stdout);
        }
        if (i == 0 && why[0] != '\0') {
            break; // there is nothing to compare others with
        }
    }
    pm_progress_finish(&progress);
    return status;
}

static void remove_folder(const char *path) {
    DIR *folder = opendir(path);
    const struct dirent *entry;
    while (folder != NULL && (entry = readdir(folder)) != NULL) {
        char inner[PATH_MAX];
        snprintf(inner, sizeof inner, "%s/%s", path, entry->d_name);
        if (entry->d_name[0] != '.' && unlink(inner) != 0) {
            remove_folder(inner);
        }
    }
    if (folder != NULL) {
        closedir(folder);
    }
    rmdir(path);
}

static pm_status execute(const pm_run_options *options) {
    const char *temporary = getenv("TMPDIR");
    assembly a = {.options = options, .json = options->json ? stdout : NULL};
    crossing *port = NULL;
    pm_ledger ledger;
    pm_status status;
    PM_TRY_DONE(pm_prepare(&a.setup, options, PM_TO_COORDINATE));
    const pm_scene *scene = a.setup.scene;
    if (scene->network.nlive > 0 && (a.setup.replay == NULL || options->processes)) {
        PM_TRY_DONE(
            pm_fail(PM_EUSAGE, options->processes
                                   ? "bench: --processes is for scenes without live inputs"
                                   : "test: live inputs need a recording of them: --replay FILE"));
    }
    if (a.setup.replay != NULL && a.setup.replayed < scene->run.steps && options->steps == 0) {
        a.setup.scene->run.steps = (int)a.setup.replayed;
    }
    PM_TRY_DONE(options->processes ? PM_OK : pm_prepare_check_steps(&a.setup, options));
    if (!options->here) {
        PM_TRY_DONE(enter_private_network());
    }
    snprintf(a.folder, sizeof a.folder, "%.30s/portmet-test-XXXXXX",
             temporary == NULL ? "/tmp" : temporary);
    if (mkdtemp(a.folder) == NULL) {
        status = pm_fail(PM_EFILE, "%s: %s", a.folder, strerror(errno));
        a.folder[0] = '\0';
        goto done;
    }
    if (options->processes) {
        PM_TRY_DONE(pm_scene_text_read(scene->path, &a.text));
        PM_TRY_DONE(pm_scene_text_check(a.text, options->write, options->weights));
        a.mean = strdup(a.text);
        PM_TRY_DONE(pm_allocated(a.mean, "a scene"));
        PM_TRY_DONE(pm_scene_text_put_mean_inputs(&a.mean, &a.setup.boundary_input));
        pm_run_options held = *options;
        held.text = a.mean;
        pm_setup_free(&a.setup);
        PM_TRY_DONE(pm_prepare(&a.setup, &held, PM_TO_COORDINATE));
        status = bench_processes(&a);
        goto done;
    }
    port = pm_arena_array(&a.setup.arena, (size_t)scene->physics.nport, sizeof *port);
    PM_TRY_DONE(pm_arena_status(&a.setup.arena, "the ports of a test"));
    PM_TRY_DONE(run_here(&a, port, &ledger));
    PM_TRY_DONE(pm_scene_text_read(scene->path, &a.text));
    PM_TRY_DONE(pm_scene_text_put(&a.text, "record", NULL));
    const pm_stepping stepping = {scene->physics.integrator, scene->physics.substeps,
                                  scene->physics.tolerance, scene->physics.dt, a.steps};
    PM_TRY_DONE(pm_scene_text_put_time(&a.text, &stepping));
    PM_TRY_DONE(make_trials(&a));
    print_ports(&a, port, &ledger);
    if (a.json != NULL) {
        fprintf(a.json, "],\"failed\":%d,\"violations\":%ld}\n", a.failed, ledger.violations);
    }
    if (a.failed > 0) {
        status = pm_fail(PM_EBROKEN, "test: %d of %d runs failed, the first %s", a.failed, a.count,
                         a.first);
    } else if (ledger.violations > 0) {
        status = pm_fail(
            PM_EBROKEN, "test: %ld of %d steps violate a law (%s)", ledger.violations, a.steps,
            ledger.worst_energy_place >= 0 ? pm_ledger_name(&ledger, ledger.worst_energy_place)
                                           : "a whole step");
    } else if (a.json == NULL) {
        printf("All %d runs gave the same bits and kept both laws.\n", a.count);
    }
done:
    if (a.folder[0] != '\0') {
        remove_folder(a.folder);
    }
    free(a.text);
    free(a.mean);
    pm_setup_free(&a.setup);
    return status;
}

const pm_command pm_command_test = {
    .name = "test",
    .summary = "test a scene as an assembly of processes",
    .arguments = "SCENE",
    .help =
        "Runs the scene in one process, and compares with this, bit by bit, runs in a process for\n"
        "each subsystem and in other cuts, over LCM, sealed and over MPI, with losses, late and\n"
        "repeated messages, processes that are killed or stopped, and from checkpoints. Prints a\n"
        "table of these runs, and for each port what crosses it, the largest residual, and "
        "whether\n"
        "it carries anything. Ends with exit code 14 if a run has other bits, fails or violates a\n"
        "law; the error names the first difference by subsystem, variable and step. The runs use "
        "a\n"
        "private network, which root may make, or anybody where user namespaces are allowed. With\n"
        "--other the last process reads other weights, as if its host had a copy of its own.",
    .examples = "portmetd test configs/double_pendulum.yaml\n"
                "portmetd test scene.yaml --here --steps 20",
    .accepts = "steps weights url replay test json",
    .execute = execute,
};
