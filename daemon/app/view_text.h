// The messages of a view as JSON (RFC 8259): what the page receives over its websocket, and what
// other tools receive over UDP. A number that is not finite is written as null.
#ifndef PM_APP_VIEW_TEXT_H
#define PM_APP_VIEW_TEXT_H

#include <stdio.h>

#include "app/view_graph.h"
#include "lockstep/health.h"

// Each function writes one JSON object, without a line end, to `file`.

// {"scene": {"name", "recording", "dt", "steps", "subsystems", "ports", "nodes": [{"name",
// "count"}], "parts", "edges": [{"name", "a", "b", "count"}]}}: the graph. The first `parts` nodes
// are subsystems or groups of them, the others boundary inputs; a and b are positions of nodes.
// `recording` is the name of the file that is shown, or NULL.
void pm_view_write_scene(FILE *file, const pm_view_graph *graph, const char *recording);

// {"frame": {"session", "step", "time", "energy", "entropy", "energy_residual", "entropy_residual",
// "violations", "parts": [energies, entropies, productions], "edges": [energy fluxes into a,
// likewise into b, entropy fluxes into a, likewise into b]}}: a frame as in view_graph.h.
void pm_view_write_frame(FILE *file, const pm_view_graph *graph, const double *frame);

// {"health": {"step", "steps", "rate", "blocker", "over", "processes", "rows": [{"name", "step",
// "rate", "silent", "cpu", "busy", "waits_for", "waits", "asks", "answers", "loses_from", "loss",
// "drops", "strange", "checkpoint", "memory"}]}}: fields of health_t. Of more than PM_VIEW_MOST
// processes only some rows are written: those that are silent, miss messages, or are busiest.
void pm_view_write_health(FILE *file, const pm_scene *scene, const portmet_health_t *health,
                          bool over);

// Receives one text [size] of pm_view_write_values.
typedef void pm_view_sender(void *context, const char *text, size_t size);

// Writes the values of a frame and of the health (NULL: none) under their names, as PlotJuggler
// expects them: {"timestamp": s, "SCENE": {"energy": {"NAME": J}}}. The kinds are "total",
// "energy", "entropy", "production", "power", "entropy_flux" and "process". The power through a
// port is the energy flux into its second end. Passes one or more such texts, of at most some
// thousand bytes each, to `send`. PM_ENOMEM.
pm_status pm_view_write_values(const pm_view_graph *graph, const double *frame,
                               const portmet_health_t *health, pm_view_sender *send, void *context);

#endif
