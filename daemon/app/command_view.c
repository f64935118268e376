// portmetd view: shows a run, or a recording, as a page in a browser, and sends its values as JSON
// over UDP. A sample of the run becomes a frame, which is a row of numbers; some hundred frames
// are kept, and each client receives those that it does not have.
#include <arpa/inet.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/notify.h"
#include "app/view_server.h"
#include "base/journal.h"
#include "library/names.h"
#include "lockstep/health.h"
#include "lockstep/listener.h"
#include "lockstep/remote.h"
#include "scene/recording.h"
#include "store/hdf5_io.h"

#define INTERVAL 0.05          // s between two looks at what has arrived
#define MOST_SHOWN 200         // subsystems, or processes, that are shown one by one
#define GROUPS 64              // groups of a larger scene
#define MOST_ROWS 50           // processes of a larger scene
#define MOST_FRAMES 512        // frames that are kept; large frames are fewer
#define LEAST_FRAMES 16        // frames that are kept, however large they are
#define MOST_NUMBERS (4 << 20) // of all frames together: 32 MiB
#define DATAGRAM_SIZE 1400     // bytes, at which a text of values ends, so that it fits a packet
#define NAME_SIZE 256          // bytes of the name of a node, a value or a series
#define TEXT_SIZE 8192         // bytes of a name or path in JSON, at most
#define MOST_STATES 512        // components of the states that are shown
#define DEFAULT_PORT 8080      // of the page
#define CONTROL_PATIENCE 1.0   // s for a service to answer what the page asks for
#define DEFAULT_ADDRESS "127.0.0.1"

// The numbers of a frame: first the TOTALS below; then the energy (J), the entropy (J/K) and the
// entropy production within (W/K) of each part; then the energy flux (W) into end 0 and end 1 and
// the entropy flux (W/K) into end 0 and end 1 of each edge; then the states that are shown. All
// behind the totals follow twice more: the least and the largest value since the frame before.
enum {
    SESSION_HIGH, // the upper and the lower 32 bits of the session's number, since a double
    SESSION_LOW,  // cannot hold it as a whole
    STEP,
    TIME,             // s
    ENERGY,           // J, of the ledger, as the four after it
    ENTROPY,          // J/K
    ENERGY_RESIDUAL,  // 1
    ENTROPY_RESIDUAL, // 1
    VIOLATIONS,       // steps
    SEEN,             // samples of the run so far, of which the curves are made
    TOTALS
};
enum { PER_PART = 3, PER_EDGE = 4 };

// A subsystem, a group of them, or a boundary input.
typedef struct view_node {
    const char *name; // of the subsystem, or of the first one of the group
    int count;        // number of subsystems; 0: a boundary input
} view_node;

typedef struct view_edge {
    const char *name; // of the port, or of the first one
    int end[2];       // nodes
    int count;        // number of ports
} view_edge;

// The scene as a graph. A scene with more than MOST_SHOWN subsystems is summarised: consecutive
// subsystems form a group, whose energies and entropies are sums, and the ports between two groups
// form one edge, whose fluxes are sums. Ports within a group are not shown.
typedef struct view_graph {
    int npart; // nodes that are subsystems or groups; they come before the boundary inputs
    int nnode, nedge;
    view_node *node;            // [nnode]
    view_edge *edge;            // [nedge]
    int *node_of;               // [nsubsystem]; -1: the subsystem is not shown
    int *edge_of;               // [nport]; -1: the port is within a group, or not shown
    int *first_end;             // [nport] the end of the port at end 0 of its edge
    int nstate;                 // components of states that are shown
    int *state_at;              // [nstate] their places in the state of the scene
    const char **state, **unit; // [nstate] their names and units
} view_graph;

// The frames that are kept: they are spread over the whole run. Whenever the memory is full, every
// second one is forgotten and from then on half as many are kept. The newest frame is kept apart.
// A frame that is not kept widens the bounds of the next one that is.
typedef struct view_history {
    int width;       // numbers in a frame
    int shown;       // of them behind the totals, without their bounds
    int capacity;    // frames, an even number
    int count;       // frames kept
    int64_t stride;  // one of so many frames is kept
    int64_t newest;  // number of the newest frame; the first one has the number 1; 0: none
    int64_t *number; // [capacity] numbers of the frames, ascending
    double *frame;   // [capacity][width]
    double *bounds;  // [2][shown] of the frames since the last one that was kept
} view_history;

typedef struct view {
    const pm_run_options *options;
    pm_arena arena;
    pm_scene *scene;
    view_graph graph;
    view_history history;
    double *frame;  // [history.width] the newest frame
    double *sample; // [2][history.shown] bounds of the samples since the newest frame
    int64_t heard;  // session of these samples
    double seen;    // samples of this session
    pm_transport *transport;
    pm_listener *listener; // NULL: a recording is shown
    pm_view_server *server;
    int datagrams;                // file descriptor; -1: none are sent
    int64_t session, step;        // of the newest frame
    int64_t health;               // number of the newest state of health
    int64_t health_count;         // health messages that it counts
    bool health_over;             // whether it says that the run is over
    pm_transport *control;        // on which the service is asked; NULL: not yet
    pm_client *client;            // of the service
    bool allowed;                 // the service does what views ask for
    int64_t said;                 // number of the last answer
    char answer[PM_TEXT_MAX + 1]; // what the service says; "": it has done it
} view;

// --- the graph ---

// Makes the edges. If they are `summed`, two nodes have one edge at most.
static void add_edges(view_graph *g, const pm_scene *scene, bool summed) {
    for (int i = 0; i < scene->physics.nport; ++i) {
        const pm_scene_port *port = &scene->physics.port[i];
        int end[2];
        for (int k = 0; k < 2; ++k) {
            end[k] = port->subsystem[k] >= 0 ? g->node_of[port->subsystem[k]]
                                             : g->npart + port->boundary_input[k];
        }
        g->edge_of[i] = -1;
        if (end[0] == end[1] || end[0] < 0 || end[1] < 0) {
            continue;
        }
        g->first_end[i] = end[0] < end[1] ? 0 : 1;
        const int a = end[g->first_end[i]], b = end[1 - g->first_end[i]];
        int k = summed ? 0 : g->nedge;
        while (k < g->nedge && (g->edge[k].end[0] != a || g->edge[k].end[1] != b)) {
            ++k;
        }
        if (k == g->nedge) {
            g->edge[g->nedge++] = (view_edge){.name = port->name, .end = {a, b}};
        }
        g->edge[k].count += 1;
        g->edge_of[i] = k;
    }
}

// Names the states of the subsystems that are shown one by one, if they are few. A whole recording
// has those of a range in one array, which is not shown.
static pm_status name_states(view *v, const bool *shown) {
    const pm_scene *scene = v->scene;
    view_graph *g = &v->graph;
    pm_scene_variables names;
    PM_TRY(pm_scene_variable_names(&names, scene, &v->arena));
    g->state = pm_arena_array(&v->arena, (size_t)scene->physics.nz, sizeof *g->state);
    g->unit = pm_arena_array(&v->arena, (size_t)scene->physics.nz, sizeof *g->unit);
    g->state_at = pm_arena_array(&v->arena, (size_t)scene->physics.nz, sizeof *g->state_at);
    PM_TRY(pm_arena_status(&v->arena, "the states of %s", scene->name));
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        const bool in_array = v->options->recording != NULL && shown == NULL && s->range != NULL;
        if ((shown != NULL && !shown[i]) || in_array) {
            continue;
        }
        for (int c = 0; c < s->layout.nz; ++c, ++g->nstate) {
            g->state[g->nstate] = names.state.name[s->first + c];
            g->unit[g->nstate] = names.state.unit[s->first + c];
            g->state_at[g->nstate] = s->first + c;
        }
    }
    g->nstate = g->nstate > MOST_STATES ? 0 : g->nstate;
    return PM_OK;
}

// --- bounds: the least values [n], then the largest ones [n] ---

static void forget_bounds(double *bounds, int n) {
    for (int i = 0; i < 2 * n; ++i) {
        bounds[i] = NAN;
    }
}

// Widens bounds [2][n] so that they hold the values from low [n] to high [n]. NaN is no value.
static void widen(double *bounds, const double *low, const double *high, int n) {
    for (int i = 0; i < n; ++i) {
        bounds[i] = fmin(bounds[i], low[i]);
        bounds[n + i] = fmax(bounds[n + i], high[i]);
    }
}

static pm_status make_graph(view *v) {
    const pm_scene *scene = v->scene;
    view_graph *g = &v->graph;
    view_history *h = &v->history;
    // A recording may have some subsystems alone.
    const bool *shown = v->options->recording == NULL ? NULL : scene->run.recorded;
    int nshown = 0;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        nshown += shown == NULL || shown[i];
    }
    const bool summed = nshown > MOST_SHOWN;
    const size_t nport = (size_t)scene->physics.nport + 1;
    g->npart = summed ? GROUPS : nshown;
    g->nnode = g->npart + scene->physics.nboundary_input;
    g->node = pm_arena_array(&v->arena, (size_t)g->nnode, sizeof *g->node);
    g->node_of = pm_arena_array(&v->arena, (size_t)scene->physics.nsubsystem, sizeof *g->node_of);
    g->edge = pm_arena_array(&v->arena, nport, sizeof *g->edge);
    g->edge_of = pm_arena_array(&v->arena, nport, sizeof *g->edge_of);
    g->first_end = pm_arena_array(&v->arena, nport, sizeof *g->first_end);
    PM_TRY(pm_arena_status(&v->arena, "a view of %s", scene->name));
    // The nodes.
    for (int i = 0, k = 0; i < scene->physics.nsubsystem; ++i) {
        g->node_of[i] = -1;
        if (shown == NULL || shown[i]) {
            g->node_of[i] = (int)((long)k++ * g->npart / nshown);
            view_node *node = &g->node[g->node_of[i]];
            if (node->count++ == 0) {
                node->name = scene->physics.subsystem[i].name;
            }
        }
    }
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        g->node[g->npart + i].name = scene->physics.boundary_input[i].name;
    }
    add_edges(g, scene, summed);
    if (!summed) {
        PM_TRY(name_states(v, shown));
    }
    h->shown = PER_PART * g->npart + PER_EDGE * g->nedge + g->nstate;
    h->width = TOTALS + 3 * h->shown;
    const int room = MOST_NUMBERS / h->width / 2 * 2;
    h->capacity = room < LEAST_FRAMES ? LEAST_FRAMES : room > MOST_FRAMES ? MOST_FRAMES : room;
    h->stride = 1;
    const size_t capacity = (size_t)h->capacity, width = (size_t)h->width;
    h->number = pm_arena_array(&v->arena, capacity, sizeof *h->number);
    h->frame = pm_arena_array(&v->arena, capacity * width, sizeof *h->frame);
    h->bounds = pm_arena_array(&v->arena, 2 * (size_t)h->shown, sizeof *h->bounds);
    v->frame = pm_arena_array(&v->arena, width, sizeof *v->frame);
    v->sample = pm_arena_array(&v->arena, 2 * (size_t)h->shown, sizeof *v->sample);
    PM_TRY(pm_arena_status(&v->arena, "the frames of a view of %s", scene->name));
    forget_bounds(h->bounds, h->shown);
    forget_bounds(v->sample, h->shown);
    return pm_arena_status(&v->arena, "the frames of a view of %s", scene->name);
}

// Writes the name of a node into `text` [NAME_SIZE]: that of the subsystem, or "first ... (count)".
static const char *node_name(const view_node *node, char *text) {
    if (node->count > 1) {
        snprintf(text, NAME_SIZE, "%s ... (%d)", node->name, node->count);
    } else {
        snprintf(text, NAME_SIZE, "%s", node->name);
    }
    return text;
}

// --- the frames that are kept ---

static double *frame_at(const view_history *h, int i) {
    return h->frame + (size_t)i * (size_t)h->width;
}

// Adds a copy of frame [width], if it is one of those to be kept.
static void keep_frame(view_history *h, const double *frame) {
    const size_t size = (size_t)h->width * sizeof *frame;
    const int bounds = TOTALS + h->shown, n = h->shown;
    h->newest += 1;
    widen(h->bounds, frame + bounds, frame + bounds + n, n);
    if (h->count > 0 && h->newest < h->number[h->count - 1] + h->stride) {
        return;
    }
    if (h->count == h->capacity) {
        h->count /= 2;
        h->stride *= 2;
        for (int i = 1; i < h->count; ++i) {
            h->number[i] = h->number[2 * i];
            const double *between = frame_at(h, 2 * i - 1) + bounds;
            widen(frame_at(h, 2 * i) + bounds, between, between + n, n);
            memcpy(frame_at(h, i), frame_at(h, 2 * i), size);
        }
    }
    h->number[h->count] = h->newest;
    memcpy(frame_at(h, h->count), frame, size);
    widen(frame_at(h, h->count++) + bounds, h->bounds, h->bounds + n, n);
    forget_bounds(h->bounds, n);
}

// --- frames of a recording ---

typedef struct recording_reader {
    pm_hdf5 *file;
    const char *path;
    const view *view;
    int rows;      // complete samples in the file
    int stride;    // one of so many is kept
    bool summed;   // several series make one number
    double *value; // [most] numbers read from the file
    int *at;       // [most] position in a frame of each member of a range; -1: none
} recording_reader;

// Reads the series `name`, which has one number for each sample, into memory that the caller frees.
// Without the series *value is NULL: a recording need not have every number.
static pm_status read_series(const recording_reader *r, const char *name, double **value) {
    int rows = 0;
    if (!pm_hdf5_has(r->file, name)) {
        return PM_OK;
    }
    PM_TRY(pm_hdf5_shape(r->file, name, 1, &rows));
    if (rows < r->rows) {
        return pm_fail(PM_EFILE, "%s: %s has %d samples, expected %d", r->path, name, rows,
                       r->rows);
    }
    *value = calloc((size_t)rows, sizeof **value);
    return *value == NULL ? pm_fail(PM_ENOMEM, "%s: out of memory", r->path)
                          : pm_hdf5_read(r->file, name, 1, &rows, *value);
}

// Adds a series to the numbers at position `at` of all frames. Without it they become NaN.
static pm_status add_series(const recording_reader *r, const char *name, int at) {
    const view_history *h = &r->view->history;
    double *value = NULL;
    const pm_status status = read_series(r, name, &value);
    for (int i = 0; i < h->count && status == PM_OK; ++i) {
        frame_at(h, i)[at] += value == NULL ? (double)NAN : value[(long)i * r->stride];
    }
    // The samples between widen the bounds of a number that has no other series.
    for (int i = 0; i < h->count && value != NULL && status == PM_OK && !r->summed && at >= TOTALS;
         ++i) {
        double *low = frame_at(h, i) + at + h->shown, *high = low + h->shown;
        for (long k = i == 0 ? 0 : (long)(i - 1) * r->stride + 1; k <= (long)i * r->stride; ++k) {
            *low = fmin(*low, value[k]);
            *high = fmax(*high, value[k]);
        }
    }
    free(value);
    return status;
}

// Adds a quantity of a family of subsystems or ports to the numbers at the positions r->at of all
// frames, one for each member.
static pm_status add_family(const recording_reader *r, const char *folder,
                            const pm_recorded_family *family, const char *quantity) {
    const view_history *h = &r->view->history;
    char name[NAME_SIZE];
    snprintf(name, sizeof name, "/%s/%s/%s", folder, family->name, quantity);
    if (!family->is_range) {
        return r->at[0] < 0 ? PM_OK : add_series(r, name, r->at[0]);
    }
    for (int i = 0; i < h->count; ++i) {
        PM_TRY(pm_hdf5_read_row(r->file, name, i * r->stride, family->count, r->value));
        for (int k = 0; k < family->count; ++k) {
            if (r->at[k] >= 0) {
                frame_at(h, i)[r->at[k]] += r->value[k];
            }
        }
    }
    return PM_OK;
}

// Adds the energies and entropies of all nodes and the fluxes of all edges.
static pm_status add_components(recording_reader *r, const pm_recorded_families *families) {
    static const char *const of_part[PER_PART] = {"E", "S", "bulk_entropy"};
    static const char *const of_edge[PER_EDGE] = {"energy_flux_a", "energy_flux_b",
                                                  "entropy_flux_a", "entropy_flux_b"};
    const view_graph *g = &r->view->graph;
    for (int i = 0; i < families->nsubsystem * PER_PART; ++i) {
        const pm_recorded_family *family = &families->subsystem[i / PER_PART];
        for (int k = 0; k < family->count; ++k) {
            const int node = g->node_of[family->first + k];
            r->at[k] = node < 0 ? -1 : TOTALS + i % PER_PART * g->npart + node;
        }
        PM_TRY(add_family(r, "subsystems", family, of_part[i % PER_PART]));
    }
    const int first = TOTALS + PER_PART * g->npart;
    for (int i = 0; i < families->nport * PER_EDGE; ++i) {
        const pm_recorded_family *family = &families->port[i / PER_EDGE];
        for (int k = 0; k < family->count; ++k) {
            const int id = family->first + k, edge = g->edge_of[id];
            const int shown = i % PER_EDGE ^ g->first_end[id];
            r->at[k] = edge < 0 ? -1 : first + shown * g->nedge + edge;
        }
        PM_TRY(add_family(r, "ports", family, of_edge[i % PER_EDGE]));
    }
    return PM_OK;
}

// Adds the states of the subsystems whose names name_states has listed.
static pm_status add_states(const recording_reader *r, const pm_recorded_families *families) {
    const view_history *h = &r->view->history;
    const view_graph *g = &r->view->graph;
    const pm_physics *physics = &r->view->scene->physics;
    int at = TOTALS + h->shown - g->nstate;
    char name[NAME_SIZE];
    for (int f = 0; f < families->nsubsystem && g->nstate > 0; ++f) {
        const pm_recorded_family *family = &families->subsystem[f];
        const int nz = physics->subsystem[family->first].layout.nz;
        if (family->is_range || at + nz > TOTALS + h->shown) {
            continue;
        }
        snprintf(name, sizeof name, "/subsystems/%s/z", family->name);
        for (int i = 0; i < h->count; ++i) {
            PM_TRY(pm_hdf5_read_row(r->file, name, i * r->stride, nz, frame_at(h, i) + at));
        }
        at += nz;
    }
    return PM_OK;
}

// Counts up to each frame the samples in which a residual is beyond the tolerance of its law.
static pm_status count_violations(const recording_reader *r) {
    const pm_run *run = &r->view->scene->run;
    double *energy = NULL, *entropy = NULL, count = 0;
    pm_status status;
    PM_TRY_DONE(read_series(r, "/ledger/energy_residual", &energy));
    PM_TRY_DONE(read_series(r, "/ledger/entropy_residual", &entropy));
    for (int i = 0; i < r->rows; ++i) {
        count += energy == NULL || entropy == NULL   ? (double)NAN
                 : energy[i] > run->energy_tolerance ? 1
                                                     : -entropy[i] > run->entropy_tolerance;
        if (i % r->stride == 0) {
            frame_at(&r->view->history, i / r->stride)[VIOLATIONS] = count;
        }
    }
done:
    free(energy);
    free(entropy);
    return status;
}

// Reads all samples of the recording, or as many as the history keeps, evenly spread. PM_EFILE: the
// file cannot be read, or is no recording of this scene. PM_ENOMEM.
static pm_status read_recording(view *v) {
    static const struct {
        const char *name;
        int at;
    } totals[] = {{"/time", TIME},
                  {"/ledger/energy", ENERGY},
                  {"/ledger/entropy", ENTROPY},
                  {"/ledger/energy_residual", ENERGY_RESIDUAL},
                  {"/ledger/entropy_residual", ENTROPY_RESIDUAL}};
    const pm_scene *scene = v->scene;
    view_history *h = &v->history;
    recording_reader r = {.path = v->options->recording, .view = v};
    r.summed = v->graph.npart < scene->physics.nsubsystem && scene->run.recorded == NULL;
    uint64_t committed;
    pm_status status;
    PM_TRY_DONE(pm_hdf5_open(&r.file, r.path, PM_HDF5_ANY, PM_EFILE));
    PM_TRY_DONE(pm_hdf5_read_integer(r.file, "/", "committed", &committed));
    PM_TRY_DONE(pm_hdf5_shape(r.file, "/time", 1, &r.rows));
    if (committed < 1 || committed > (uint64_t)r.rows) {
        PM_TRY_DONE(pm_fail(PM_EFILE, "%s: %" PRIu64 " of %d samples are complete", r.path,
                            committed, r.rows));
    }
    // If the recording has all subsystems, it has the first one: look for that.
    const char *range = scene->physics.subsystem[0].range;
    char first[NAME_SIZE];
    snprintf(first, sizeof first, "/subsystems/%s",
             range == NULL ? scene->physics.subsystem[0].name : range);
    if (scene->run.recorded == NULL && !pm_hdf5_has(r.file, first)) {
        PM_TRY_DONE(pm_fail(PM_EFILE, "%s: no recording of scene %s: it has no %s", r.path,
                            scene->name, first));
    }
    const int most = scene->physics.nsubsystem > scene->physics.nport ? scene->physics.nsubsystem
                                                                      : scene->physics.nport;
    pm_recorded_families families;
    r.value = pm_arena_array(&v->arena, (size_t)most, sizeof *r.value);
    r.at = pm_arena_array(&v->arena, (size_t)most, sizeof *r.at);
    PM_TRY_DONE(pm_arena_status(&v->arena, "%s", r.path));
    PM_TRY_DONE(pm_recorded_families_find(&families, &v->arena, scene));
    r.rows = (int)committed;
    r.stride = (r.rows + h->capacity - 1) / h->capacity;
    h->count = (r.rows + r.stride - 1) / r.stride;
    h->newest = h->count;
    for (int i = 0; i < h->count; ++i) {
        h->number[i] = i + 1;
        forget_bounds(frame_at(h, i) + TOTALS + h->shown, h->shown);
    }
    for (size_t i = 0; i < sizeof totals / sizeof totals[0]; ++i) {
        PM_TRY_DONE(add_series(&r, totals[i].name, totals[i].at));
    }
    bool whole = !r.summed; // all samples widen the bounds
    for (int i = 0; i < families.nsubsystem; ++i) {
        whole = whole && !families.subsystem[i].is_range;
    }
    for (int i = 0; i < h->count; ++i) {
        double *frame = frame_at(h, i);
        frame[STEP] = round(frame[TIME] / scene->physics.dt);
        frame[SEEN] = 1 + (double)i * (whole ? r.stride : 1);
    }
    PM_TRY_DONE(count_violations(&r));
    PM_TRY_DONE(add_components(&r, &families));
    PM_TRY_DONE(add_states(&r, &families));
    for (int i = 0; i < h->count; ++i) { // what the frame shows is within
        double *number = frame_at(h, i) + TOTALS;
        widen(number + h->shown, number, number, h->shown);
    }
done:
    pm_hdf5_close(r.file);
    return status;
}

static void try_read(const void *context) {
    view v = *(const view *)context; // whose memory is the child's
    (void)read_recording(&v);
}

// --- messages as JSON (RFC 8259) ---

// Every name is a name of the scene, and every value a number or such a name. A number that is not
// finite is written as null.

static void put_text(FILE *file, const char *text) {
    char quoted[TEXT_SIZE];
    pm_json_quote(quoted, sizeof quoted, text);
    fputs(quoted, file);
}

static void put_number(FILE *file, double value) {
    if (isfinite(value)) {
        fprintf(file, "%.15g", value);
    } else {
        fputs("null", file);
    }
}

static void put_field(FILE *file, const char *name, double value) {
    fprintf(file, ",\"%s\":", name);
    put_number(file, value);
}

// Writes `count` lists of `width` numbers.
static void put_lists(FILE *file, const double *value, int count, int width) {
    for (int i = 0; i < count; ++i) {
        fputs(i == 0 ? "[[" : ",[", file);
        for (int k = 0; k < width; ++k) {
            fputs(k == 0 ? "" : ",", file);
            put_number(file, value[i * width + k]);
        }
        fputc(']', file);
    }
    fputc(']', file);
}

// {"scene": {"name", "recording", "dt", "steps", "subsystems", "ports", "nodes": [{"name",
// "count"}], "parts", "edges": [{"name", "a", "b", "count"}]}}: the graph. The first `parts` nodes
// are subsystems or groups of them, the others boundary inputs; a and b are positions of nodes. The
// list "states": [{"name", "unit"}] follows. Frames of a run have them while it is recorded.
static void write_scene(FILE *file, const view *v) {
    const pm_scene *scene = v->scene;
    const view_graph *g = &v->graph;
    char name[NAME_SIZE];
    fputs("{\"scene\":{\"name\":", file);
    put_text(file, scene->name);
    fputs(",\"recording\":", file);
    if (v->options->recording == NULL) {
        fputs("null", file);
    } else {
        put_text(file, v->options->recording);
    }
    put_field(file, "dt", scene->physics.dt);
    fprintf(file, ",\"steps\":%d,\"subsystems\":%d,\"ports\":%d,\"parts\":%d,\"nodes\":[",
            scene->run.steps, scene->physics.nsubsystem, scene->physics.nport, g->npart);
    for (int i = 0; i < g->nnode; ++i) {
        fputs(i == 0 ? "{\"name\":" : ",{\"name\":", file);
        put_text(file, node_name(&g->node[i], name));
        fprintf(file, ",\"count\":%d}", g->node[i].count);
    }
    fputs("],\"edges\":[", file);
    for (int i = 0; i < g->nedge; ++i) {
        const view_edge *edge = &g->edge[i];
        fputs(i == 0 ? "{\"name\":" : ",{\"name\":", file);
        put_text(file, edge->name);
        fprintf(file, ",\"a\":%d,\"b\":%d,\"count\":%d}", edge->end[0], edge->end[1], edge->count);
    }
    fputs("],\"states\":[", file);
    for (int i = 0; i < g->nstate; ++i) {
        fputs(i == 0 ? "{\"name\":" : ",{\"name\":", file);
        put_text(file, g->state[i]);
        fputs(",\"unit\":", file);
        put_text(file, g->unit[i]);
        fputc('}', file);
    }
    fputs("]}}", file);
}

// {"frame": {"session", "step", "time", "energy", "entropy", "energy_residual", "entropy_residual",
// "violations", "seen", "parts": [energies, entropies, productions], "edges": [energy fluxes into
// a, likewise into b, entropy fluxes into a, likewise into b], "states": [states]}}. Where values
// since the frame before lie beyond those of this frame, "low": [bounds] and "high": [bounds]
// follow, of all numbers from "parts" on.
static void write_frame(FILE *file, const view_graph *g, const view_history *h,
                        const double *frame) {
    static const char *const totals[] = {
        "step",       "time", "energy", "entropy", "energy_residual", "entropy_residual",
        "violations", "seen",
    };
    const double *low = frame + TOTALS + h->shown;
    // The page's numbers are doubles, too: it receives a text, which it only compares.
    fprintf(file, "{\"frame\":{\"session\":\"%" PRIu64 "\"",
            (uint64_t)frame[SESSION_HIGH] << 32 | (uint64_t)frame[SESSION_LOW]);
    for (int i = STEP; i < TOTALS; ++i) {
        put_field(file, totals[i - STEP], frame[i]);
    }
    fputs(",\"parts\":", file);
    put_lists(file, frame + TOTALS, PER_PART, g->npart);
    fputs(",\"edges\":", file);
    put_lists(file, frame + TOTALS + PER_PART * g->npart, PER_EDGE, g->nedge);
    fputs(",\"states\":", file);
    put_lists(file, low - g->nstate, 1, g->nstate);
    bool wider = false;
    for (int i = 0; i < h->shown; ++i) {
        wider = wider || low[i] < frame[TOTALS + i] || low[h->shown + i] > frame[TOTALS + i];
    }
    for (int i = 0; i < 2 && wider; ++i) {
        fputs(i == 0 ? ",\"low\":" : ",\"high\":", file);
        put_lists(file, low + i * h->shown, 1, h->shown);
    }
    fputs("}}", file);
}

static void put_peer(FILE *file, const char *name, const pm_scene *scene, int64_t peer) {
    fprintf(file, ",\"%s\":", name);
    if (peer == PM_HEALTH_NOBODY) {
        fputs("null", file);
    } else {
        put_text(file, pm_health_name(scene, peer));
    }
}

// Measures how much a process holds up the others.
static double urgency(const portmet_health_t *h, int i) {
    return (h->silent[i] < 0 || h->silent[i] > PM_HEALTH_SILENT ? 100 : 0) + 10 * h->loss[i] +
           h->computing[i];
}

// Returns true if process i is written: of many processes only the MOST_ROWS most urgent ones are.
static bool is_written(const portmet_health_t *h, int i) {
    int before = 0;
    for (int k = 0; h->nprocess > MOST_SHOWN && k < h->nprocess && before < MOST_ROWS; ++k) {
        const double difference = urgency(h, k) - urgency(h, i);
        before += difference > 0 || (difference == 0 && k < i);
    }
    return before < MOST_ROWS;
}

// {"health": {"step", "steps", "rate", "blocker", "over", "processes", "rows": [{"name", "step",
// "rate", "silent", "cpu", "busy", "waits_for", "waits", "asks", "answers", "loses_from", "loss",
// "drops", "strange", "checkpoint", "memory"}]}}: fields of health_t.
static void write_health(FILE *file, const pm_scene *scene, const portmet_health_t *h, bool over) {
    fprintf(file, "{\"health\":{\"step\":%lld,\"steps\":%lld", (long long)h->step,
            (long long)h->steps);
    put_field(file, "rate", h->rate);
    put_peer(file, "blocker", scene, h->blocker);
    fprintf(file, ",\"over\":%s,\"processes\":%d,\"rows\":[", over ? "true" : "false", h->nprocess);
    bool first = true;
    for (int i = 0; i < h->nprocess; ++i) {
        if (!is_written(h, i)) {
            continue;
        }
        fputs(first ? "{\"name\":" : ",{\"name\":", file);
        first = false;
        put_text(file, scene->network.process[i].name);
        put_field(file, "step", (double)h->process_step[i]);
        put_field(file, "rate", h->process_rate[i]);
        put_field(file, "silent", h->silent[i]);
        put_field(file, "cpu", h->cpu[i]);
        put_field(file, "busy", h->computing[i]);
        put_peer(file, "waits_for", scene, h->waits_for[i]);
        put_field(file, "waits", h->waits_part[i]);
        put_field(file, "asks", h->asks[i]);
        put_field(file, "answers", h->answers[i]);
        put_peer(file, "loses_from", scene, h->loses_from[i]);
        put_field(file, "loss", h->loss[i]);
        put_field(file, "drops", (double)h->drops[i]);
        put_field(file, "strange", (double)h->strange[i]);
        put_field(file, "checkpoint", h->checkpoint_age[i]);
        put_field(file, "memory", (double)h->rss[i]);
        fputc('}', file);
    }
    fputs("]}}", file);
}

// --- control ---

static void close_client(view *v) {
    pm_remote_close(v->client);
    pm_transport_close(v->control);
    v->client = NULL;
    v->control = NULL;
}

// Asks the service for what a client of the page wants: "query" tells alone whether it may.
static pm_status ask(view *v, const char *word) {
    static const struct {
        const char *word;
        portmet_control_t request;
    } words[] = {
        {"query", {.kind = PORTMET_CONTROL_T_QUERY}},
        {"start", {.kind = PORTMET_CONTROL_T_START}},
        {"hold", {.kind = PORTMET_CONTROL_T_PAUSE}},
        {"step", {.kind = PORTMET_CONTROL_T_ADVANCE, .steps = 1}},
        {"reset", {.kind = PORTMET_CONTROL_T_RESET, .held = 1}},
        {"stop", {.kind = PORTMET_CONTROL_T_STOP}},
    };
    const size_t count = sizeof words / sizeof *words;
    size_t k = 0;
    while (k < count && strcmp(words[k].word, word) != 0) {
        ++k;
    }
    if (k == count || v->listener == NULL) {
        return PM_OK;
    }
    if (v->client == NULL) {
        const pm_remote_options as = {v->scene->name, "view", 0, CONTROL_PATIENCE,
                                      v->options->stop};
        const char *address;
        v->allowed = false;
        PM_TRY(pm_connect_listener(v->scene, v->options->url, &address));
        PM_TRY(pm_connect_open(&v->control, v->scene, address, "view", &v->options->log));
        PM_TRY(pm_remote_open(&v->client, v->control, &as));
    }
    v->allowed = strstr(pm_remote_served(v->client)->description, "\"view\":true") != NULL;
    PM_TRY(pm_remote_ask(v->client, &words[0].request, true));
    portmet_control_t request = words[k].request;
    const bool held = pm_remote_reply(v->client)->phase == PORTMET_CONTROL_REPLY_T_HELD;
    if (request.kind == PORTMET_CONTROL_T_START) {
        request.steps = v->scene->run.steps;
        request.kind = held ? PORTMET_CONTROL_T_RESUME : request.kind;
    }
    return k == 0 ? PM_OK
                  : pm_remote_ask(v->client, &request, request.kind != PORTMET_CONTROL_T_START);
}

// Does what a client of the page has sent, and tells all of them how that went.
static void hear(void *context, const char *word) {
    view *v = context;
    const pm_status status = ask(v, word);
    v->said += 1;
    snprintf(v->answer, sizeof v->answer, "%s", status == PM_OK ? "" : pm_error());
    if (status == PM_ETIMEOUT || status == PM_ECONFIG || status == PM_ENET) {
        close_client(v); // it may be another service the next time
    }
}

// Writes the next message that a client of the page has not received.
static bool write_next(void *context, pm_view_progress *progress, FILE *file) {
    const view *v = context;
    if (progress->scene == 0) {
        progress->scene = 1;
        progress->control = v->said;
        write_scene(file, v);
        return true;
    }
    if (progress->control != v->said) {
        progress->control = v->said;
        fprintf(file, "{\"control\":{\"allowed\":%s,\"said\":", v->allowed ? "true" : "false");
        put_text(file, v->answer);
        fputs("}}", file);
        return true;
    }
    const portmet_health_t *health = v->listener == NULL ? NULL : pm_listener_health(v->listener);
    if (health != NULL && progress->health != v->health) {
        progress->health = v->health;
        write_health(file, v->scene, health, pm_listener_is_over(v->listener));
        return true;
    }
    // The next frame is the first one kept that the client does not have, or the newest one.
    const view_history *h = &v->history;
    int low = 0, high = h->count;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (h->number[middle] <= progress->frame) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    if (low == h->count && (h->count == 0 || h->newest <= progress->frame)) {
        return false;
    }
    progress->frame = low < h->count ? h->number[low] : h->newest;
    write_frame(file, &v->graph, h, low < h->count ? frame_at(h, low) : v->frame);
    return true;
}

// --- values under their names ---

// A text {"timestamp": s, "SCENE": {"energy": {"NAME": J}}}, as PlotJuggler expects it. The kinds
// are "total", "energy", "entropy", "production", "power", "entropy_flux" and "process". When the
// text is long enough it is sent, and another one begins.
typedef struct value_writer {
    const view *view;
    FILE *file; // NULL: no text has begun
    char *text;
    size_t size;
    const char *kind; // of the value before
    bool failed;
} value_writer;

// Sends the text. It does not matter whether anybody receives it.
static void end_text(value_writer *w) {
    if (w->file == NULL) {
        return;
    }
    fputs("}}}", w->file);
    if (fclose(w->file) == 0) {
        (void)send(w->view->datagrams, w->text, w->size, 0);
    } else {
        w->failed = true;
    }
    free(w->text);
    w->file = NULL;
}

// Writes one value; `kind` is a literal, so that equal kinds have equal addresses.
static void put_value(value_writer *w, const char *kind, const char *name, double value) {
    if (!isfinite(value)) {
        return;
    }
    if (w->file != NULL && ftell(w->file) > DATAGRAM_SIZE) {
        end_text(w);
    }
    if (w->file == NULL) {
        w->file = open_memstream(&w->text, &w->size);
        if (w->file == NULL) {
            w->failed = true;
            return;
        }
        fputs("{\"timestamp\":", w->file);
        put_number(w->file, w->view->frame[TIME]);
        fputc(',', w->file);
        put_text(w->file, w->view->scene->name);
        fputs(":{", w->file);
        w->kind = NULL;
    }
    if (w->kind != kind) {
        fprintf(w->file, "%s\"%s\":{", w->kind == NULL ? "" : "},", kind);
    } else {
        fputc(',', w->file);
    }
    w->kind = kind;
    put_text(w->file, name);
    fputc(':', w->file);
    put_number(w->file, value);
}

// Sends the values of the newest frame and of the health. The power through a port is the energy
// flux into its second end. PM_ENOMEM.
static pm_status send_values(const view *v) {
    static const char total[] = "total", process[] = "process";
    static const char *const of_part[PER_PART] = {"energy", "entropy", "production"};
    static const char *const of_edge[PER_EDGE] = {NULL, "power", NULL, "entropy_flux"};
    const view_graph *g = &v->graph;
    const double *part = v->frame + TOTALS, *flux = part + PER_PART * g->npart;
    const portmet_health_t *h = pm_listener_health(v->listener);
    value_writer w = {.view = v};
    char name[NAME_SIZE];
    put_value(&w, total, "step", v->frame[STEP]);
    put_value(&w, total, "energy", v->frame[ENERGY]);
    put_value(&w, total, "entropy", v->frame[ENTROPY]);
    put_value(&w, total, "energy_residual", v->frame[ENERGY_RESIDUAL]);
    put_value(&w, total, "entropy_residual", v->frame[ENTROPY_RESIDUAL]);
    put_value(&w, total, "violations", v->frame[VIOLATIONS]);
    if (h != NULL) {
        put_value(&w, total, "steps_per_second", h->rate);
    }
    for (int k = 0; k < PER_PART * g->npart; ++k) {
        put_value(&w, of_part[k / g->npart], node_name(&g->node[k % g->npart], name), part[k]);
    }
    for (int k = 0; k < PER_EDGE * g->nedge; ++k) {
        if (of_edge[k / g->nedge] != NULL) {
            put_value(&w, of_edge[k / g->nedge], g->edge[k % g->nedge].name, flux[k]);
        }
    }
    for (int i = 0; h != NULL && i < h->nprocess; ++i) {
        const struct {
            const char *name;
            double value;
        } shown[] = {{"steps_per_second", h->process_rate[i]},
                     {"busy", h->computing[i]},
                     {"drops", (double)h->drops[i]}};
        for (size_t k = 0; k < sizeof shown / sizeof shown[0]; ++k) {
            if (is_written(h, i) && h->silent[i] >= 0) {
                snprintf(name, sizeof name, "%s/%s", v->scene->network.process[i].name,
                         shown[k].name);
                put_value(&w, process, name, shown[k].value);
            }
        }
    }
    end_text(&w);
    return w.failed ? pm_fail(PM_ENOMEM, "view: out of memory for values") : PM_OK;
}

// --- a run ---

// Writes the numbers of a sample behind the totals of a frame to `number` [shown].
static void number_sample(const view *v, const pm_sample *sample, double *number) {
    const view_graph *g = &v->graph;
    double *const edge = number + PER_PART * g->npart;
    memset(number, 0, (size_t)v->history.shown * sizeof *number);
    for (int i = 0; i < v->scene->physics.nsubsystem; ++i) {
        const int k = g->node_of[i];
        number[k] += sample->energy[i];
        number[g->npart + k] += sample->entropy[i];
        number[2 * g->npart + k] += sample->bulk_entropy[i];
    }
    for (int i = 0; i < v->scene->physics.nport; ++i) {
        const int k = g->edge_of[i];
        for (int end = 0; end < 2 && k >= 0; ++end) {
            const pm_flux *flux = &sample->flux[i][g->first_end[i] ^ end];
            edge[end * g->nedge + k] += flux->energy;
            edge[(2 + end) * g->nedge + k] += flux->entropy;
        }
    }
    double *const state = edge + PER_EDGE * g->nedge;
    for (int i = 0; i < g->nstate; ++i) {
        state[i] = pm_listener_has_state(v->listener) ? sample->z[g->state_at[i]] : (double)NAN;
    }
    const int nflow = sample->step == 0 ? g->npart + PER_EDGE * g->nedge : 0;
    for (int i = 0; i < nflow; ++i) { // productions and fluxes are those of a step
        number[2 * g->npart + i] = NAN;
    }
}

// Makes a frame of the newest sample, if it is a new one.
static pm_status take_frame(view *v) {
    const int64_t session = pm_listener_session(v->listener);
    const pm_sample *sample = pm_listener_sample(v->listener);
    const portmet_ledger_t *ledger = pm_listener_ledger(v->listener);
    const int n = v->history.shown;
    double *const frame = v->frame;
    if (sample == NULL || (session == v->session && sample->step == v->step)) {
        return PM_OK;
    }
    if (session != v->session) { // numbers of frames go on
        v->history.count = 0;
        v->history.stride = 1;
        forget_bounds(v->history.bounds, n);
    }
    v->session = session;
    v->step = sample->step;
    frame[SESSION_HIGH] = (double)((uint64_t)session >> 32);
    frame[SESSION_LOW] = (double)(uint32_t)session;
    frame[STEP] = (double)sample->step;
    frame[TIME] = sample->time;
    frame[ENERGY] = ledger == NULL ? (double)NAN : ledger->energy;
    frame[ENTROPY] = ledger == NULL ? (double)NAN : ledger->entropy;
    frame[ENERGY_RESIDUAL] = ledger == NULL ? (double)NAN : ledger->energy_residual;
    frame[ENTROPY_RESIDUAL] = ledger == NULL ? (double)NAN : ledger->entropy_residual;
    frame[VIOLATIONS] = ledger == NULL ? (double)NAN : (double)ledger->violations;
    frame[SEEN] = v->seen;
    if (ledger == NULL && sample->step == 0) { // nothing came from outside yet
        frame[ENERGY] = frame[ENTROPY] = 0;
        for (int i = 0; i < v->scene->physics.nsubsystem; ++i) {
            frame[ENERGY] += sample->energy[i];
            frame[ENTROPY] += sample->entropy[i];
        }
    }
    number_sample(v, sample, frame + TOTALS);
    memcpy(frame + TOTALS + n, v->sample, 2 * (size_t)n * sizeof *frame);
    forget_bounds(v->sample, n);
    keep_frame(&v->history, frame);
    return v->datagrams < 0 ? PM_OK : send_values(v);
}

// Takes note of every sample that the listener completes.
static void note_sample(void *context, const pm_sample *sample) {
    view *v = context;
    const int n = v->history.shown;
    const int64_t session = pm_listener_session(v->listener);
    const bool first = session != v->heard;
    if (first) {
        v->heard = session;
        v->seen = 0;
        forget_bounds(v->sample, n);
    }
    v->seen += 1;
    number_sample(v, sample, v->frame + TOTALS);
    widen(v->sample, v->frame + TOTALS, v->frame + TOTALS, n);
    if (first) { // changes count from here; what fails, for want of memory, fails again later
        (void)take_frame(v);
    }
}

// --- opening ---

static pm_status open_view(view *v) {
    const pm_run_options *options = v->options;
    struct in_addr any;
    if (options->bind != NULL && inet_pton(AF_INET, options->bind, &any) != 1) {
        return pm_fail(PM_EUSAGE, "--bind %s: expected an IPv4 address of this host, such as %s",
                       options->bind, "0.0.0.0 for all");
    }
    if (options->recording != NULL && options->udp != 0) {
        return pm_fail(PM_EUSAGE, "--udp is for runs, and --recording for the page");
    }
    PM_TRY(pm_scene_load(&v->scene, options->scene));
    PM_TRY(make_graph(v));
    if (options->recording != NULL) {
        PM_TRY(pm_hdf5_try(options->recording, try_read, v));
        PM_TRY(read_recording(v));
    } else {
        const char *address;
        PM_TRY(pm_connect_check(v->scene));
        PM_TRY(pm_connect_listener(v->scene, options->url, &address));
        PM_TRY(pm_connect_open(&v->transport, v->scene, address, "view", &options->log));
        PM_TRY(pm_listener_open(&v->listener, v->transport, v->scene, options->session));
        pm_listener_set_handler(v->listener, note_sample, v);
    }
    if (options->udp != 0) {
        const int port = (int)options->udp;
        const struct sockaddr_in to = {.sin_family = AF_INET,
                                       .sin_port = htons((uint16_t)port),
                                       .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
        v->datagrams = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
        if (v->datagrams < 0 ||
            connect(v->datagrams, (const struct sockaddr *)&to, sizeof to) != 0) {
            return pm_fail(PM_ENET, "--udp %d: no socket: %s", port, strerror(errno));
        }
        printf("portmetd: values of %s as JSON to udp://127.0.0.1:%d\n", v->scene->name, port);
    }
    if (options->udp == 0 || options->port != 0) { // the page is served unless only --udp is given
        const char *address = options->bind == NULL ? DEFAULT_ADDRESS : options->bind;
        const int port = options->port == 0 ? DEFAULT_PORT : (int)options->port;
        PM_TRY(pm_view_server_open(&v->server, address, port, write_next, hear, v));
        printf("portmetd: a view of %s at http://%s:%d/\n", v->scene->name, address, port);
    }
    fflush(stdout);
    pm_notify("READY=1");
    return PM_OK;
}

static pm_status execute(const pm_run_options *options) {
    view v = {.options = options, .datagrams = -1, .step = -1};
    pm_status status;
    PM_TRY_DONE(open_view(&v));
    while (*options->stop == 0) {
        if (v.listener != NULL) {
            PM_TRY_DONE(pm_listener_read(v.listener));
            PM_TRY_DONE(take_frame(&v));
            const int64_t count = pm_listener_health_count(v.listener);
            const bool over = pm_listener_is_over(v.listener);
            v.health += count != v.health_count || over != v.health_over;
            v.health_count = count;
            v.health_over = over;
        }
        if (v.server != NULL) {
            PM_TRY_DONE(pm_view_server_serve(v.server, INTERVAL, options->stop));
        } else {
            (void)nanosleep(&(struct timespec){.tv_nsec = (long)(1e9 * INTERVAL)}, NULL);
        }
    }
    status = pm_fail(PM_EINTERRUPTED, "interrupted");
done:
    pm_view_server_close(v.server);
    close_client(&v);
    pm_listener_close(v.listener);
    pm_transport_close(v.transport);
    if (v.datagrams >= 0) {
        close(v.datagrams);
    }
    pm_arena_free(&v.arena);
    pm_scene_free(v.scene);
    return status;
}

const pm_command pm_command_view = {
    .name = "view",
    .summary = "show a run or a recording in a browser",
    .arguments = "SCENE",
    .help =
        "Shows a run of the scene, which goes on beside it on this or any other host of the\n"
        "network, as a page in a browser: the subsystems as a graph, with arrows as wide as the\n"
        "power through each port; both laws; energies and entropies over time; and how each\n"
        "process is doing. The page can stop at any time of the run. A view shows whatever run of\n"
        "the scene it hears, one after the other. It can start, hold, step, reset and stop runs "
        "of a\n"
        "service that was started with `--control view`, and of no other. With --recording it "
        "shows\n"
        "a recording. It ends when it is interrupted.",
    .examples = "portmetd view configs/chain_10.yaml --port 8080\n"
                "portmetd view configs/chain_10.yaml --recording run.h5",
    .accepts = "port bind udp recording url session",
    .execute = execute,
};
