// JSON by hand: every name is a name of the scene, and every value a number or such a name.
#include "app/view_text.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

#include "base/json.h"

#define NAME_SIZE 256
#define TEXT_SIZE 8192     // bytes of a name or path in JSON, at most
#define MOST_ROWS 50       // processes of a summarised scene
#define DATAGRAM_SIZE 1400 // bytes, at which a text of values ends, so that it fits into a packet

// --- tokens ---

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

static void put_numbers(FILE *file, const double *value, int count) {
    for (int i = 0; i < count; ++i) {
        fputc(i == 0 ? '[' : ',', file);
        put_number(file, value[i]);
    }
    fputs(count == 0 ? "[]" : "]", file);
}

// Writes `count` lists of `width` numbers.
static void put_lists(FILE *file, const double *value, int count, int width) {
    for (int i = 0; i < count; ++i) {
        fputc(i == 0 ? '[' : ',', file);
        put_numbers(file, value + i * width, width);
    }
    fputc(']', file);
}

// --- the scene ---

void pm_view_write_scene(FILE *file, const pm_view_graph *graph, const char *recording) {
    const pm_scene *scene = graph->scene;
    fputs("{\"scene\":{\"name\":", file);
    put_text(file, scene->name);
    fputs(",\"recording\":", file);
    if (recording == NULL) {
        fputs("null", file);
    } else {
        put_text(file, recording);
    }
    put_field(file, "dt", scene->dt);
    fprintf(file, ",\"steps\":%d,\"subsystems\":%d,\"ports\":%d,\"parts\":%d,\"nodes\":[",
            scene->steps, scene->nsubsystem, scene->nport, graph->npart);
    for (int i = 0; i < graph->nnode; ++i) {
        char name[NAME_SIZE];
        pm_view_node_name(graph, i, name, sizeof name);
        fputs(i == 0 ? "{\"name\":" : ",{\"name\":", file);
        put_text(file, name);
        fprintf(file, ",\"count\":%d}", graph->node[i].count);
    }
    fputs("],\"edges\":[", file);
    for (int i = 0; i < graph->nedge; ++i) {
        const pm_view_edge *edge = &graph->edge[i];
        fputs(i == 0 ? "{\"name\":" : ",{\"name\":", file);
        put_text(file, edge->name);
        fprintf(file, ",\"a\":%d,\"b\":%d,\"count\":%d}", edge->end[0], edge->end[1], edge->count);
    }
    fputs("]}}", file);
}

// --- a frame ---

void pm_view_write_frame(FILE *file, const pm_view_graph *graph, const double *frame) {
    static const char *const totals[] = {
        "step", "time", "energy", "entropy", "energy_residual", "entropy_residual", "violations",
    };
    // The page's numbers are doubles, too: it receives a text, which it only compares.
    fprintf(file, "{\"frame\":{\"session\":\"%" PRIu64 "\"",
            (uint64_t)frame[PM_VIEW_SESSION_HIGH] << 32 | (uint64_t)frame[PM_VIEW_SESSION_LOW]);
    for (int i = PM_VIEW_STEP; i < PM_VIEW_TOTALS; ++i) {
        put_field(file, totals[i - PM_VIEW_STEP], frame[i]);
    }
    const double *part = frame + PM_VIEW_TOTALS;
    fputs(",\"parts\":", file);
    put_lists(file, part, PM_VIEW_PER_PART, graph->npart);
    fputs(",\"edges\":", file);
    put_lists(file, part + PM_VIEW_PER_PART * graph->npart, PM_VIEW_PER_EDGE, graph->nedge);
    fputs("}}", file);
}

// --- health ---

static void put_peer(FILE *file, const char *name, const pm_scene *scene, int64_t peer) {
    fprintf(file, ",\"%s\":", name);
    if (peer == PM_HEALTH_NOBODY) {
        fputs("null", file);
    } else {
        put_text(file, pm_health_name(scene, peer));
    }
}

static void put_row(FILE *file, const pm_scene *scene, const portmet_health_t *h, int i) {
    fputs("{\"name\":", file);
    put_text(file, scene->process[i].name);
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

// The larger, the more a process holds up the others.
static double urgency(const portmet_health_t *h, int i) {
    return (h->silent[i] < 0 || h->silent[i] > PM_HEALTH_SILENT ? 100 : 0) + 10 * h->loss[i] +
           h->computing[i];
}

// Returns true if fewer than MOST_ROWS processes are more urgent than process i.
static bool is_written(const portmet_health_t *h, int i) {
    int before = 0;
    for (int k = 0; h->nprocess > PM_VIEW_MOST && k < h->nprocess && before < MOST_ROWS; ++k) {
        const double difference = urgency(h, k) - urgency(h, i);
        before += difference > 0 || (difference == 0 && k < i);
    }
    return before < MOST_ROWS;
}

void pm_view_write_health(FILE *file, const pm_scene *scene, const portmet_health_t *health,
                          bool over) {
    fprintf(file, "{\"health\":{\"step\":%lld,\"steps\":%lld", (long long)health->step,
            (long long)health->steps);
    put_field(file, "rate", health->rate);
    put_peer(file, "blocker", scene, health->blocker);
    fprintf(file, ",\"over\":%s,\"processes\":%d,\"rows\":[", over ? "true" : "false",
            health->nprocess);
    bool first = true;
    for (int i = 0; i < health->nprocess; ++i) {
        if (is_written(health, i)) {
            fputs(first ? "" : ",", file);
            put_row(file, scene, health, i);
            first = false;
        }
    }
    fputs("]}}", file);
}

// --- values under their names ---

// A text that is being written: it ends when it is long enough, and another one begins.
typedef struct value_writer {
    const pm_view_graph *graph;
    double time;
    pm_view_sender *send;
    void *context;
    FILE *file; // NULL: no text has begun
    char *text;
    size_t size;
    const char *kind; // of the value before
    bool failed;
} value_writer;

static void end_text(value_writer *w) {
    if (w->file == NULL) {
        return;
    }
    fputs("}}}", w->file);
    if (fclose(w->file) == 0) {
        w->send(w->context, w->text, w->size);
    } else {
        w->failed = true;
    }
    free(w->text);
    w->file = NULL;
}

static void begin_text(value_writer *w) {
    w->file = open_memstream(&w->text, &w->size);
    if (w->file == NULL) {
        w->failed = true;
        return;
    }
    fputs("{\"timestamp\":", w->file);
    put_number(w->file, w->time);
    fputc(',', w->file);
    put_text(w->file, w->graph->scene->name);
    fputs(":{", w->file);
    w->kind = NULL;
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
        begin_text(w);
    }
    if (w->file == NULL) {
        return;
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

static void put_totals(value_writer *w, const double *frame, const portmet_health_t *health) {
    static const char kind[] = "total";
    put_value(w, kind, "step", frame[PM_VIEW_STEP]);
    put_value(w, kind, "energy", frame[PM_VIEW_ENERGY]);
    put_value(w, kind, "entropy", frame[PM_VIEW_ENTROPY]);
    put_value(w, kind, "energy_residual", frame[PM_VIEW_ENERGY_RESIDUAL]);
    put_value(w, kind, "entropy_residual", frame[PM_VIEW_ENTROPY_RESIDUAL]);
    put_value(w, kind, "violations", frame[PM_VIEW_VIOLATIONS]);
    if (health != NULL) {
        put_value(w, kind, "steps_per_second", health->rate);
    }
}

static void put_parts(value_writer *w, const double *frame) {
    static const char *const kinds[PM_VIEW_PER_PART] = {"energy", "entropy", "production"};
    const int npart = w->graph->npart;
    for (int k = 0; k < PM_VIEW_PER_PART; ++k) {
        for (int i = 0; i < npart; ++i) {
            char name[NAME_SIZE];
            pm_view_node_name(w->graph, i, name, sizeof name);
            put_value(w, kinds[k], name, frame[PM_VIEW_TOTALS + k * npart + i]);
        }
    }
}

static void put_edges(value_writer *w, const double *frame) {
    static const char *const kinds[PM_VIEW_PER_EDGE] = {NULL, "power", NULL, "entropy_flux"};
    const int nedge = w->graph->nedge;
    const double *flux = frame + PM_VIEW_TOTALS + PM_VIEW_PER_PART * w->graph->npart;
    for (int k = 1; k < PM_VIEW_PER_EDGE; k += 2) {
        for (int i = 0; i < nedge; ++i) {
            put_value(w, kinds[k], w->graph->edge[i].name, flux[k * nedge + i]);
        }
    }
}

static void put_processes(value_writer *w, const portmet_health_t *h) {
    static const char kind[] = "process";
    for (int i = 0; i < h->nprocess; ++i) {
        const char *name = w->graph->scene->process[i].name;
        if (!is_written(h, i) || h->silent[i] < 0) {
            continue;
        }
        char text[NAME_SIZE];
        snprintf(text, sizeof text, "%s/steps_per_second", name);
        put_value(w, kind, text, h->process_rate[i]);
        snprintf(text, sizeof text, "%s/busy", name);
        put_value(w, kind, text, h->computing[i]);
        snprintf(text, sizeof text, "%s/drops", name);
        put_value(w, kind, text, (double)h->drops[i]);
    }
}

pm_status pm_view_write_values(const pm_view_graph *graph, const double *frame,
                               const portmet_health_t *health, pm_view_sender *send,
                               void *context) {
    value_writer w = {
        .graph = graph, .time = frame[PM_VIEW_TIME], .send = send, .context = context};
    put_totals(&w, frame, health);
    put_parts(&w, frame);
    put_edges(&w, frame);
    if (health != NULL) {
        put_processes(&w, health);
    }
    end_text(&w);
    return w.failed ? pm_fail(PM_ENOMEM, "view: out of memory for values") : PM_OK;
}
