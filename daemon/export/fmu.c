// Writes a scene as an FMU: fills in its texts (folder text) in a temporary folder, compiles the
// sources there, and packs all of it. States are outputs, values that follow a column or are live
// are inputs, other prescribed values are parameters, and energies, entropies, fluxes, co-energies
// and the reactions that the outside feels are outputs. Every port is a terminal, and so is the
// outside: there each co-energy that it prescribes stands beside the reaction to it.
#include "export/fmu.h"

#include <errno.h>
#include <float.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "base/child.h"
#include "base/files.h"
#include "base/template.h"
#include "base/unit.h"
#include "export/source.h"
#include "library/names.h"
#include "model/training_range.h"

// The texts, which the build embeds as arrays of lines that end with NULL. Those of fmi hold no
// keys.
extern const char *const pm_fmu_types_text[];
extern const char *const pm_fmu_interface_text[];
extern const char *const pm_fmu_state_text[];
extern const char *const pm_fmu_unused_text[];
extern const char *const pm_fmu_glue_text[];
extern const char *const pm_fmu_build_text[];
extern const char *const pm_fmu_model_text[];
extern const char *const pm_fmu_terminals_text[];
extern const char *const pm_fmu_second_text[];
extern const char *const pm_fmu_second_model_text[];
extern const char *const pm_fmu_page_text[];
extern const char *const pm_fmu_license_text[];

static const struct {
    const char *folder, *name; // in the archive
    const char *const *text;
    int version; // of FMI that has it; 0: all
} files[] = {
    {"sources/", "model.h", pm_fmu_glue_text, 0},
    {"sources/", "fmi3.h", pm_fmu_types_text, 0},
    {"sources/", "fmi3.c", pm_fmu_interface_text, 0},
    {"sources/", "fmi3_state.c", pm_fmu_state_text, 0},
    {"sources/", "fmi3_unused.c", pm_fmu_unused_text, 0},
    {"sources/", "buildDescription.xml", pm_fmu_build_text, 3},
    {"", "modelDescription.xml", pm_fmu_model_text, 3},
    {"sources/", "fmi2.c", pm_fmu_second_text, 2},
    {"", "modelDescription.xml", pm_fmu_second_model_text, 2},
    {"terminalsAndIcons/", "terminalsAndIcons.xml", pm_fmu_terminals_text, 3},
    {"documentation/", "index.html", pm_fmu_page_text, 0},
    {"documentation/licenses/", "license.txt", pm_fmu_license_text, 0},
};
enum { NFILE = sizeof files / sizeof files[0] };

#define OUT_OF_MEMORY "an FMU" // what there was no memory for
#define ZIP_VERSION 20         // of the format of the archive: folders
#define ZIP_DATE 0x0021        // 1 January 1980, so that the same scene gives the same bytes
#define LARGEST_MEMBER INT32_MAX
#define ABILITIES                                                  \
    "canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\" " \
    "providesDirectionalDerivatives=\"true\" providesAdjointDerivatives=\"true\""

static const char *const fluxes[4] = {"energy_flux_a", "entropy_flux_a", "energy_flux_b",
                                      "entropy_flux_b"};

// The value references of an FMU (fmi/fmi3.c). Each member is the reference of the first variable
// of its kind; the others follow it. The reference 0 is the time.
typedef struct fmu_references {
    int state, derivative, input, energy, entropy, flux, slope, reaction, departure, ledger, guard;
    int end;
} fmu_references;

// The kinds of variables.
enum { EXACT, CALCULATED, LOCAL, INPUT, PARAMETER };
enum { LEDGER = 3 }; // variables of the ledger

typedef struct variable {
    const char *name, *unit, *description; // name NULL: the reference has no variable
    int kind;
    int position;          // among all variables, from 1
    int state;             // reference of the state whose derivative it is
    double start, nominal; // nominal: of states
    double low, high;      // of states in training; NAN: not known
} variable;

// --- the archive ---
//
// A ZIP archive whose members are stored as they are (PKWARE, APPNOTE 6.3.3): local headers,
// members, and the central directory.

typedef struct archive_member {
    const char *name;
    uint32_t crc, size, offset;
    struct archive_member *older;
} archive_member;

// `file` and `arena` are borrowed.
typedef struct archive {
    FILE *file;
    pm_arena *arena;
    int count;
    archive_member *newest;
} archive;

static uint32_t crc_of(const unsigned char *bytes, size_t size) {
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < size; ++i) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; ++bit) {
            crc = crc >> 1 ^ ((crc & 1) != 0 ? UINT32_C(0xedb88320) : 0);
        }
    }
    return ~crc;
}

static void put16(FILE *file, unsigned value) {
    fputc((int)(value & 0xff), file);
    fputc((int)(value >> 8 & 0xff), file);
}

static void put32(FILE *file, uint32_t value) {
    put16(file, value & 0xffff);
    put16(file, value >> 16);
}

// Writes what the local header and the directory's entry of a member have in common.
static void put_common(FILE *file, const archive_member *m) {
    put16(file, ZIP_VERSION);
    put16(file, 0); // flags
    put16(file, 0); // stored
    put16(file, 0); // time
    put16(file, ZIP_DATE);
    put32(file, m->crc);
    put32(file, m->size);
    put32(file, m->size);
    put16(file, (unsigned)strlen(m->name));
    put16(file, 0); // extra field
}

// Adds a member `bytes` [size] under `name`, of which the arena keeps a copy. PM_ENOMEM. PM_EFILE:
// the member or the archive is larger than 2 GiB. A failure to write sets ferror(a->file), which
// the caller checks at the end.
static pm_status add_member(archive *a, const char *name, const void *bytes, size_t size) {
    const long offset = ftell(a->file);
    archive_member *m = pm_arena_alloc(a->arena, sizeof *m);
    const char *kept = pm_arena_strdup(a->arena, name);
    if (m == NULL || kept == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an archive");
    }
    if (offset < 0 || offset > LARGEST_MEMBER || size > LARGEST_MEMBER) {
        return pm_fail(PM_EFILE, "%s: %zu bytes are too large for an archive", name, size);
    }
    *m = (archive_member){kept, crc_of(bytes, size), (uint32_t)size, (uint32_t)offset, a->newest};
    a->newest = m;
    ++a->count;
    put32(a->file, 0x04034b50);
    put_common(a->file, m);
    fputs(name, a->file);
    fwrite(bytes, 1, size, a->file);
    return PM_OK;
}

// Writes the directory with which the archive ends.
static void finish_archive(const archive *a) {
    FILE *file = a->file;
    const long begin = ftell(file);
    for (const archive_member *m = a->newest; m != NULL; m = m->older) {
        put32(file, 0x02014b50);
        put16(file, ZIP_VERSION);
        put_common(file, m);
        put16(file, 0); // comment
        put16(file, 0); // disk
        put16(file, 0); // internal attributes
        put32(file, 0); // external attributes
        put32(file, m->offset);
        fputs(m->name, file);
    }
    const long end = ftell(file);
    put32(file, 0x06054b50);
    put16(file, 0);
    put16(file, 0);
    put16(file, (unsigned)a->count);
    put16(file, (unsigned)a->count);
    put32(file, (uint32_t)(end - begin));
    put32(file, (uint32_t)begin);
    put16(file, 0); // comment
}

typedef struct fmu_writer {
    int version;        // of FMI: 2 or 3
    const char *author; // of the model; NULL: not given
    const pm_setup *setup;
    const pm_scene *scene;
    pm_arena *arena;
    fmu_references reference;
    pm_scene_variables names;
    variable *variable; // [reference.end] by reference
    double *first;      // [nprescribed] values of the boundary inputs at the start
    const char *folder; // temporary
    archive archive;
} fmu_writer;

// --- units ---

// Writes a text as the value of an attribute.
static void put_text(FILE *file, const char *text) {
    for (; *text != '\0'; ++text) {
        switch (*text) {
        case '&':
            fputs("&amp;", file);
            break;
        case '<':
            fputs("&lt;", file);
            break;
        case '>':
            fputs("&gt;", file);
            break;
        case '"':
            fputs("&quot;", file);
            break;
        default:
            fputc(*text, file);
        }
    }
}

// Returns a unit as Modelica writes it: "kg.m2/s" for "kg m^2/s".
static const char *modelica(const fmu_writer *w, const char *unit) {
    char *text = pm_arena_strdup(w->arena, unit);
    char *to = text;
    for (const char *from = unit; text != NULL && *from != '\0'; ++from) {
        if (*from != '^') {
            *to++ = *from == ' ' || *from == '*' ? '.' : *from;
        }
    }
    if (text != NULL) {
        *to = '\0';
    }
    return text == NULL ? "" : text;
}

// Writes each unit once.
static void write_units(FILE *file, const void *context) {
    static const char *const ours[] = {"s", "J", "J/K", "W", "W/K", "1"};
    static const char *const base[] = {"kg", "m", "s", "A", "K", "mol"};
    const fmu_writer *w = context;
    const pm_physics *physics = &w->scene->physics;
    const pm_scene_variables *v = &w->names;
    const struct {
        const char *const *unit;
        int count;
    } all[] = {{ours, 6},
               {v->state.unit, physics->nz},
               {v->rate.unit, physics->nz},
               {v->slope[0].unit, physics->nz},
               {v->slope[1].unit, physics->nz},
               {v->input.unit, physics->nprescribed},
               {v->reaction.unit, physics->nprescribed / 3}};
    const int most = 6 + 4 * physics->nz + 2 * physics->nprescribed;
    const char **list = pm_arena_array(w->arena, (size_t)most, sizeof *list);
    int count = 0;
    for (size_t k = 0; k < sizeof all / sizeof all[0] && list != NULL; ++k) {
        for (int i = 0; i < all[k].count; ++i) {
            const char *unit = all[k].unit[i];
            int same = 0;
            while (same < count && strcmp(list[same], unit) != 0) {
                ++same;
            }
            if (same < count) {
                continue;
            }
            list[count++] = unit;
            const pm_unit read = pm_unit_parse(unit);
            fputs("    <Unit name=\"", file);
            put_text(file, modelica(w, unit));
            if (!read.known) {
                fputs("\"/>\n", file); // such as J^0.5: the standard knows whole powers only
                continue;
            }
            fputs("\"><BaseUnit", file);
            for (int b = 0; b < PM_UNIT_BASES; ++b) {
                if (read.power[b] != 0) {
                    fprintf(file, " %s=\"%d\"", base[b], read.power[b]);
                }
            }
            if (read.factor < 1 || read.factor > 1) {
                fprintf(file, " factor=\"%.17g\"", read.factor);
            }
            fputs("/></Unit>\n", file);
        }
    }
}

// --- variables ---

// Writes a name. In the standard's structured names a part between two dots that is no identifier,
// such as dE/dp, stands in quotes.
static void put_name(FILE *file, const char *name) {
    for (const char *part = name; part != NULL;) {
        const char *dot = strchr(part, '.');
        const int whole = dot == NULL ? (int)strlen(part) : (int)(dot - part);
        const int length = (int)strcspn(part, "[.");
        const char *quote = memchr(part, '/', (size_t)length) != NULL ? "'" : "";
        fprintf(file, "%s%.*s%s%.*s%s", quote, length, part, quote, whole - length, part + length,
                dot == NULL ? "" : ".");
        part = dot == NULL ? NULL : dot + 1;
    }
}

// Writes the sizes of all states.
static void write_nominals(FILE *file, const void *context) {
    const fmu_writer *w = context;
    for (int i = w->reference.state; i < w->reference.derivative; ++i) {
        fprintf(file, "%s%.17g", i == w->reference.state ? "" : ", ", w->variable[i].nominal);
    }
}

// Return the guards of the scene; INFINITY: it has none. A system without an energy has no ledger.
static double range_guard(const fmu_writer *w) {
    return w->scene->run.largest_departure;
}

static double energy_guard(const fmu_writer *w) {
    return pm_system_without_energy(w->setup->system) < 0 ? w->scene->run.largest_drift : INFINITY;
}

// Returns a limit as a number of C.
static const char *limit(const fmu_writer *w, double value) {
    return isfinite(value) ? pm_arena_printf(w->arena, "%.17g", value) : "HUGE_VAL";
}

// Writes a sentence about each guard of the scene.
static void write_guards(FILE *file, const void *context) {
    const double range = range_guard(context), energy = energy_guard(context);
    if (isfinite(range)) {
        fprintf(file, " A step that ends further than %.4g outside fails.", range);
    }
    if (isfinite(energy)) {
        fprintf(file, " A step after which energy_change is larger than %.4g J fails.", energy);
    }
    if (isfinite(range) || isfinite(energy)) {
        fputs(" <code>guard_used</code> approaches 1 before.", file);
    }
}

// Sets a variable and returns it, so that more can be said of it.
static variable *add(fmu_writer *w, int reference, int kind, const char *name, const char *unit) {
    variable *v = &w->variable[reference];
    *v = (variable){.name = name, .unit = unit, .kind = kind, .low = NAN, .high = NAN};
    return v;
}

static void add_states(fmu_writer *w) {
    const pm_scene_variables *v = &w->names;
    const fmu_references *r = &w->reference;
    for (int i = 0; i < w->scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &w->scene->physics.subsystem[i];
        const pm_training_range range = pm_training_range_of(w->setup->system->part[i]);
        for (int c = 0, g = 0; c < s->layout.nz; ++c) {
            const int k = s->first + c;
            g += g + 1 < s->layout.ngroup && s->layout.group[g + 1].first <= c; // that has c
            variable *state = add(w, r->state + k, EXACT, v->state.name[k], v->state.unit[k]);
            state->start = w->setup->initial[k];
            // How large the states of the group are in training; 1 if that is not known.
            const double most =
                range.low == NULL ? 0 : fmax(fabs(range.low[g]), fabs(range.high[g]));
            state->nominal = most > 0 && most < DBL_MAX ? most : 1;
            const char *const group = s->layout.group[g].name, *const part = s->name;
            state->description = pm_arena_printf(w->arena, "state %s of %s", group, part);
            if (s->relative_subsystem[g] >= 0) {
                const pm_scene_subsystem *base =
                    &w->scene->physics.subsystem[s->relative_subsystem[g]];
                state->description =
                    pm_arena_printf(w->arena, "%s, measured from %s of %s", state->description,
                                    base->layout.group[s->relative_group[g]].name, base->name);
            }
            if (range.low != NULL && range.low[g] <= range.high[g]) {
                state->description = pm_arena_printf(
                    w->arena, "%s; %s from %.4g to %.4g in training", state->description,
                    s->layout.group[g].size > 1 ? "length of the vector" : "value", range.low[g],
                    range.high[g]);
                // A component of a vector is within its length. A start outside is not refused.
                const double low = s->layout.group[g].size > 1 ? -range.high[g] : range.low[g];
                const bool inside = low <= state->start && state->start <= range.high[g];
                state->low = inside ? low : NAN;
                state->high = inside ? range.high[g] : NAN;
            }
            const char *rate = pm_arena_printf(w->arena, "der(%s)", v->state.name[k]);
            variable *derivative = add(w, r->derivative + k, LOCAL, rate, v->rate.unit[k]);
            derivative->state = r->state + k;
            derivative->description = pm_arena_printf(w->arena, "rate of %s of %s", group, part);
            // The co-energies of a group that is shown by its co-energy are no variables of their
            // own.
            for (int slope = 0; slope < 2 && !s->layout.group[g].coenergy; ++slope) {
                add(w, r->slope + slope * w->scene->physics.nz + k, CALCULATED,
                    v->slope[slope].name[k], v->slope[slope].unit[k])
                    ->description = pm_arena_printf(w->arena, "derivative of the %s of %s by %s",
                                                    slope == 0 ? "energy" : "entropy", part, group);
            }
        }
    }
}

// Fills in the table of variables. PM_ENOMEM.
static pm_status add_variables(fmu_writer *w) {
    const pm_physics *physics = &w->scene->physics;
    const pm_scene_variables *v = &w->names;
    const fmu_references *r = &w->reference;
    const int ns = physics->nsubsystem;
    w->variable = pm_arena_array(w->arena, (size_t)r->end, sizeof *w->variable);
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    add_states(w);
    // A value that follows a column or is live is an input; another one a parameter, unless it is
    // zero, where the co-energies that nobody prescribes are.
    for (int i = 0; i < physics->nprescribed; ++i) {
        const pm_boundary_input *b = &w->setup->boundary_input;
        const bool follows = b->column[i] != PM_BOUNDARY_INPUT_CONSTANT || b->live_id[i] >= 0;
        if (follows || w->first[i] != 0) {
            variable *input = add(w, r->input + i, follows ? INPUT : PARAMETER, v->input.name[i],
                                  v->input.unit[i]);
            input->start = w->first[i];
            double low, high;
            input->description =
                pm_export_input_range(w->setup, i, &low, &high)
                    ? pm_arena_printf(w->arena,
                                      "what the outside prescribes; from %.4g to %.4g in training",
                                      low, high)
                    : "what the outside prescribes; no training range is known for it";
        }
    }
    for (int i = 0; i < 2 * ns; ++i) {
        const char *name = pm_arena_printf(w->arena, i < ns ? "%s.energy" : "%s.entropy",
                                           physics->subsystem[i % ns].name);
        add(w, r->energy + i, CALCULATED, name, i < ns ? "J" : "J/K")->description =
            i < ns ? "stored energy" : "stored entropy";
    }
    for (int i = 0; i < 4 * physics->nport; ++i) {
        const pm_scene_port *port = &physics->port[i / 4];
        const char *name = pm_arena_printf(w->arena, "%s.%s", port->name, fluxes[i % 4]);
        add(w, r->flux + i, CALCULATED, name, i % 2 == 0 ? "W" : "W/K")->description =
            pm_arena_printf(w->arena, "into %s", pm_scene_end_name(w->scene, port, i % 4 >= 2));
    }
    for (int i = 0; i < physics->nprescribed / 3; ++i) {
        add(w, r->reaction + i, CALCULATED, v->reaction.name[i], v->reaction.unit[i])->description =
            "rate that the ports give to the outside";
    }
    add(w, r->departure, CALCULATED, "outside_training_range", "1")->description =
        "distance to states and inputs of the training, in widths of their range";
    const bool driven = physics->nboundary_input > 0;
    static const struct {
        const char *name, *unit, *description, *of_driven;
    } ledger[LEDGER] = {
        {"energy_change", "J", "of all parts since the start: the integrator's error",
         "since the start, of all parts and of what left to the outside (not in Model Exchange)"},
        {"entropy_produced", "J/K", "since the start",
         "since the start, with what left to the outside (not in Model Exchange)"},
        {"power_residual", "W", "rate of the energy of all parts: rounding",
         "rate of the energy of all parts and of the outside: rounding"}};
    for (int i = 0; i < LEDGER && pm_system_without_energy(w->setup->system) < 0; ++i) {
        add(w, r->ledger + i, CALCULATED, ledger[i].name, ledger[i].unit)->description =
            driven ? ledger[i].of_driven : ledger[i].description;
    }
    if (isfinite(range_guard(w)) || isfinite(energy_guard(w))) {
        add(w, r->guard, CALCULATED, "guard_used", "1")->description =
            "part of the scene's guards that is used: a step that ends beyond 1 fails";
    }
    int position = 1; // the time is the first one
    for (int i = 1; i < r->end; ++i) {
        w->variable[i].position = w->variable[i].name == NULL ? 0 : ++position;
    }
    return pm_arena_status(w->arena, OUT_OF_MEMORY);
}

static void put_attribute(FILE *file, const char *name, const char *text) {
    fprintf(file, " %s=\"", name);
    put_text(file, text);
    fputs("\"", file);
}

// Writes the variables in the order of their references: in FMI 2.0 all are scalar variables with
// an element for the type.
static void write_variables(FILE *file, const void *context) {
    static const char *const attributes[] = {
        "causality=\"output\" variability=\"continuous\" initial=\"exact\"",
        "causality=\"output\" variability=\"continuous\" initial=\"calculated\"",
        "causality=\"local\" variability=\"continuous\" initial=\"calculated\"",
        "causality=\"input\" variability=\"continuous\"",
        "causality=\"parameter\" variability=\"tunable\""};
    const fmu_writer *w = context;
    const bool two = w->version == 2;
    for (int i = 1; i < w->reference.end; ++i) {
        const variable *v = &w->variable[i];
        if (v->name == NULL) {
            continue;
        }
        fputs(two ? "    <ScalarVariable name=\"" : "    <Float64 name=\"", file);
        put_name(file, v->name);
        fprintf(file, "\" valueReference=\"%d\" %s", i, attributes[v->kind]);
        if (v->description != NULL) {
            put_attribute(file, "description", v->description);
        }
        if (two) {
            fputs("><Real", file);
        } else if (v->kind == EXACT || v->kind == CALCULATED || v->kind == INPUT) {
            fputs(" intermediateUpdate=\"true\"", file);
        }
        put_attribute(file, "unit", modelica(w, v->unit));
        if (v->kind == EXACT || v->kind == INPUT || v->kind == PARAMETER) {
            fprintf(file, " start=\"%.17g\"", v->start);
        }
        if (v->kind == EXACT) {
            fprintf(file, " nominal=\"%.17g\"", v->nominal);
        }
        if (isfinite(v->low) && isfinite(v->high)) {
            fprintf(file, " min=\"%.17g\" max=\"%.17g\"", v->low, v->high);
        }
        if (v->kind == LOCAL) {
            fprintf(file, " derivative=\"%d\"", two ? w->variable[v->state].position : v->state);
        }
        fputs(two ? "/></ScalarVariable>\n" : "/>\n", file);
    }
}

// Writes the rows of the table of the documentation.
static void write_rows(FILE *file, const void *context) {
    static const char *const causality[] = {"output, with a start value", "output", "local",
                                            "input", "parameter"};
    const fmu_writer *w = context;
    for (int i = 1; i < w->reference.end; ++i) {
        const variable *v = &w->variable[i];
        if (v->name == NULL) {
            continue;
        }
        fputs("<tr><td><code>", file);
        put_name(file, v->name);
        fputs("</code></td><td>", file);
        put_text(file, modelica(w, v->unit));
        fprintf(file, "</td><td>%s</td><td>", causality[v->kind]);
        put_text(file, v->description == NULL ? "" : v->description);
        fputs("</td></tr>\n", file);
    }
}

static void write_author(FILE *file, const void *context) {
    const char *author = ((const fmu_writer *)context)->author;
    if (author != NULL) {
        put_attribute(file, "author", author);
    }
}

// --- structure ---

// Marks in known [end] the states of a subsystem, or the prescribed values of a boundary input,
// that a port shows at one end.
static void mark_end(const fmu_writer *w, const pm_scene_port *port, int end, bool *known) {
    const pm_physics *physics = &w->scene->physics;
    if (port->subsystem[end] >= 0) {
        const pm_scene_subsystem *s = &physics->subsystem[port->subsystem[end]];
        memset(known + w->reference.state + s->first, true, (size_t)s->layout.nz * sizeof *known);
        return;
    }
    const pm_scene_boundary_input *b = &physics->boundary_input[port->boundary_input[end]];
    for (int i = b->first; i < b->first + 3 * b->layout.nz; ++i) {
        known[w->reference.input + i] = w->variable[w->reference.input + i].name != NULL;
    }
}

// Marks in known [end] on which states, inputs and parameters the unknown depends.
static void mark(const fmu_writer *w, int unknown, bool *known) {
    const pm_physics *physics = &w->scene->physics;
    const fmu_references *r = &w->reference;
    int subsystem = -1, component = -1, outside = -1;
    memset(known, 0, (size_t)r->end * sizeof *known);
    if (unknown < r->derivative) {
        known[unknown] = true;
        return;
    }
    if (unknown >= r->departure) {
        memset(known + r->state, true, (size_t)physics->nz * sizeof *known);
        for (int i = r->input; i < r->energy; ++i) {
            const bool acts = unknown == r->departure || unknown == r->guard - 1;
            known[i] = acts && w->variable[i].name != NULL;
        }
        return;
    }
    if (unknown >= r->reaction) {
        outside = unknown - r->reaction;
    } else if (unknown >= r->flux && unknown < r->slope) {
        for (int end = 0; end < 2; ++end) {
            mark_end(w, &physics->port[(unknown - r->flux) / 4], end, known);
        }
        return;
    } else if (unknown >= r->energy && unknown < r->flux) {
        subsystem = (unknown - r->energy) % physics->nsubsystem;
    } else { // a rate, or a co-energy
        component =
            unknown < r->input ? unknown - r->derivative : (unknown - r->slope) % physics->nz;
        for (subsystem = 0;
             physics->subsystem[subsystem].first + physics->subsystem[subsystem].layout.nz <=
             component;) {
            ++subsystem; // that has the component
        }
    }
    if (subsystem >= 0) {
        const pm_scene_subsystem *s = &physics->subsystem[subsystem];
        memset(known + r->state + s->first, true, (size_t)s->layout.nz * sizeof *known);
    }
    // Ports act on rates and on the outside: on the variables that they expose, and through the
    // inertia of co-energies on others of the subsystem.
    for (int i = 0; i < physics->nport && (unknown < r->input || outside >= 0); ++i) {
        const pm_scene_port *port = &physics->port[i];
        bool acts = false;
        for (int end = 0; end < 2; ++end) {
            const int b = port->boundary_input[end];
            for (int c = 0; c < port->layout[end].nz; ++c) {
                const int at = port->component[end][c];
                acts = acts || (outside >= 0 && b >= 0 &&
                                physics->boundary_input[b].first / 3 + at == outside);
                acts = acts || (outside < 0 && port->subsystem[end] == subsystem &&
                                (pm_part_has_coenergies(w->setup->system->part[subsystem]) ||
                                 physics->subsystem[subsystem].first + at == component));
            }
        }
        for (int end = 0; end < 2 && acts; ++end) {
            mark_end(w, port, end, known);
        }
    }
}

// Writes the unknowns `first` to `end` - 1 as elements with what they depend on. Parameters count
// at the start only. FMI 2.0 names variables by their positions.
static void write_unknowns(FILE *file, const fmu_writer *w, const char *element, int first,
                           int end) {
    const fmu_references *r = &w->reference;
    const bool two = w->version == 2, at_start = strcmp(element, "InitialUnknown") == 0;
    bool *known = pm_arena_array(w->arena, (size_t)r->end, sizeof *known);
    for (int i = first; i < end && known != NULL; ++i) {
        if (w->variable[i].name == NULL) {
            continue;
        }
        mark(w, i, known);
        fprintf(file, "    <%s %s=\"%d\" dependencies=\"", two ? "Unknown" : element,
                two ? "index" : "valueReference", two ? w->variable[i].position : i);
        const char *blank = "";
        for (int k = r->state; k < r->energy; ++k) {
            if (known[k] && (w->variable[k].kind != PARAMETER || at_start)) {
                fprintf(file, "%s%d", blank, two ? w->variable[k].position : k);
                blank = " ";
            }
        }
        fputs("\"/>\n", file);
    }
}

static void write_structure(FILE *file, const void *context) {
    const fmu_writer *w = context;
    const fmu_references *r = &w->reference;
    const bool two = w->version == 2;
    fputs(two ? "    <Outputs>\n" : "", file);
    write_unknowns(file, w, "Output", r->state, r->derivative);
    write_unknowns(file, w, "Output", r->energy, r->end);
    fputs(two ? "    </Outputs>\n    <Derivatives>\n" : "", file);
    write_unknowns(file, w, "ContinuousStateDerivative", r->derivative, r->input);
    fputs(two ? "    </Derivatives>\n    <InitialUnknowns>\n" : "", file);
    write_unknowns(file, w, "InitialUnknown", r->derivative, r->input);
    write_unknowns(file, w, "InitialUnknown", r->energy, r->end);
    fputs(two ? "    </InitialUnknowns>\n" : "", file);
}

static void write_member(FILE *file, const char *name, const char *member, const char *kind) {
    fputs("      <TerminalMemberVariable variableName=\"", file);
    put_name(file, name);
    fprintf(file, "\" memberName=\"%s\" variableKind=\"%s\"/>\n", member, kind);
}

// Writes what both ends of a port show. Where one part is another FMU, its values are inputs here
// and outputs there, under the same names of members.
static void write_shown(FILE *file, const fmu_writer *w, const pm_scene_port *port, int end) {
    const pm_physics *physics = &w->scene->physics;
    const size_t prefix = strlen(pm_scene_end_name(w->scene, port, end)) + 1;
    const int part = port->subsystem[end], outside = port->boundary_input[end];
    for (int i = 0; i < 3 * port->layout[end].nz; ++i) {
        const int which = i / port->layout[end].nz; // the values, their co-energies, co-entropies
        const int c = port->component[end][i % port->layout[end].nz];
        const int own = part >= 0 ? physics->subsystem[part].first + c : 0;
        const int reference = part < 0
                                  ? w->reference.input + physics->boundary_input[outside].first +
                                        which * physics->boundary_input[outside].layout.nz + c
                              : which == 0 ? w->reference.state + own
                                           : w->reference.slope + (which - 1) * physics->nz + own;
        const variable *v = &w->variable[reference];
        if (v->name != NULL && v->kind != PARAMETER) {
            const char *member =
                pm_arena_printf(w->arena, "%c.%s", end == 0 ? 'a' : 'b', v->name + prefix);
            write_member(file, v->name, member == NULL ? "" : member, "signal");
        }
    }
}

// Writes a terminal for each port, with what its ends show and its fluxes, and for each boundary
// input whose co-energies are inputs, with pairs: the effort that the outside prescribes, and the
// flow that it receives.
static void write_terminals(FILE *file, const void *context) {
    const fmu_writer *w = context;
    const pm_physics *physics = &w->scene->physics;
    for (int i = 0; i < physics->nport; ++i) {
        const pm_scene_port *port = &physics->port[i];
        fprintf(file,
                "    <Terminal name=\"%s\" matchingRule=\"bus\" terminalKind=\"portmet.%s\" "
                "description=\"a: %s, b: %s\">\n",
                port->name, port->law, pm_scene_end_name(w->scene, port, 0),
                pm_scene_end_name(w->scene, port, 1));
        for (int k = 0; k < 4; ++k) {
            const char *name = pm_arena_printf(w->arena, "%s.%s", port->name, fluxes[k]);
            write_member(file, name == NULL ? "" : name, fluxes[k], "signal");
        }
        write_shown(file, w, port, 0);
        write_shown(file, w, port, 1);
        fputs("    </Terminal>\n", file);
    }
    for (int i = 0; i < physics->nboundary_input; ++i) {
        const pm_scene_boundary_input *b = &physics->boundary_input[i];
        bool open = false;
        for (int c = 0; c < b->layout.nz; ++c) {
            const int effort = b->first + b->layout.nz + c, flow = b->first / 3 + c;
            const variable *v = &w->variable[w->reference.input + effort];
            if (v->name == NULL || v->kind != INPUT) {
                continue;
            }
            if (!open) {
                fprintf(file,
                        "    <Terminal name=\"%s\" matchingRule=\"plug\" "
                        "terminalKind=\"portmet.outside\" description=\"efforts of the outside, "
                        "and flows into it\">\n",
                        b->name);
                open = true;
            }
            char member[32];
            snprintf(member, sizeof member, "effort%d", c);
            write_member(file, v->name, member, "signal");
            snprintf(member, sizeof member, "flow%d", c);
            write_member(file, w->names.reaction.name[flow], member, "outflow");
        }
        if (open) {
            fputs("    </Terminal>\n", file);
        }
    }
}

// --- packing ---

// Adds the file `plain` of the temporary folder to the archive as `name`.
static pm_status pack(fmu_writer *w, const char *name, const char *plain) {
    const char *path = pm_arena_printf(w->arena, "%s/%s", w->folder, plain);
    FILE *file = path == NULL ? NULL : fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        return pm_fail(PM_EFILE, "%s: cannot be read: %s", plain, strerror(errno));
    }
    const long size = ftell(file);
    char *bytes = pm_arena_array(w->arena, (size_t)size + 1, 1);
    rewind(file);
    const bool whole = bytes != NULL && fread(bytes, 1, (size_t)size, file) == (size_t)size;
    fclose(file);
    return whole ? add_member(&w->archive, name, bytes, (size_t)size)
                 : pm_fail(PM_EFILE, "%s: cannot be read", plain);
}

// Writes all files into the temporary folder and packs them.
static pm_status pack_all(fmu_writer *w) {
    const pm_physics *physics = &w->scene->physics;
    const char *const h = pm_arena_printf(w->arena, "%.17g", physics->dt / physics->substeps);
    const char *const dt = pm_arena_printf(w->arena, "%.17g", physics->dt);
    const char *outside = ""; // numbers of the energy fluxes into it
    for (int i = 0; i < 2 * physics->nport && outside != NULL; ++i) {
        if (physics->port[i / 2].boundary_input[i % 2] >= 0) {
            outside = pm_arena_printf(w->arena, "%s%d, ", outside, 2 * i);
        }
    }
    const pm_template_value value[] = {
        {"%NAME%", .text = w->scene->name},
        {"%VERSION%", .text = PM_VERSION},
        // The instantiationToken of FMI 3.0, by which an importer checks that description and
        // binary belong together.
        {"%TOKEN%", .text = pm_arena_printf(w->arena, "{portmet-%s-%016" PRIx64 "}", PM_VERSION,
                                            w->setup->system->digest)},
        {"%ABILITIES%", .text = ABILITIES},
        {"%H%", .text = h},
        {"%DT%", .text = dt},
        {"%SUBSTEPS%", .text = pm_arena_printf(w->arena, "%d", physics->substeps)},
        {"%STOP%", .text = pm_arena_printf(w->arena, "%.17g", physics->dt * w->scene->run.steps)},
        {"%UNITS%", .write = write_units, .context = w},
        {"%VARIABLES%", .write = write_variables, .context = w},
        {"%STRUCTURE%", .write = write_structure, .context = w},
        {"%OUTSIDE%", .text = outside},
        {"%NOMINALS%", .write = write_nominals, .context = w},
        {"%AUTHOR%", .write = write_author, .context = w},
        {"%ROWS%", .write = write_rows, .context = w},
        {"%RANGE_GUARD%", .text = limit(w, range_guard(w))},
        {"%ENERGY_GUARD%", .text = limit(w, energy_guard(w))},
        {"%GUARD_TEXT%", .write = write_guards, .context = w},
        {"%IF_PORTS%", .text = physics->nport > 0 ? "" : NULL},
        {"%TERMINALS%", .write = write_terminals, .context = w},
    };
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    for (int i = 0; i < 2; ++i) {
        const char *plain = pm_arena_printf(w->arena, "%s.%c", w->scene->name, "ch"[i]);
        const char *name = pm_arena_printf(w->arena, "sources/%s", plain);
        PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
        PM_TRY(pack(w, name, plain));
    }
    for (int i = 0; i < NFILE; ++i) {
        if (files[i].version != 0 && files[i].version != w->version) {
            continue;
        }
        const char *path = pm_arena_printf(w->arena, "%s/%s", w->folder, files[i].name);
        const char *name = pm_arena_printf(w->arena, "%s%s", files[i].folder, files[i].name);
        FILE *file = path == NULL ? NULL : fopen(path, "wb");
        if (file == NULL) {
            return pm_fail(PM_EFILE, "%s: cannot be written: %s", files[i].name, strerror(errno));
        }
        pm_template_write(file, files[i].text, INT_MAX, (int)(sizeof value / sizeof value[0]),
                          value);
        if (fclose(file) != 0) {
            return pm_fail(PM_EFILE, "%s: cannot be written: %s", files[i].name, strerror(errno));
        }
        PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
        PM_TRY(pack(w, name, files[i].name));
    }
    return PM_OK;
}

// Compiles the sources into a library for this kind of machine, and packs it.
static pm_status compile(fmu_writer *w, bool *compiled) {
    const char *name = w->scene->name, *chosen = getenv("CC");
    struct utsname machine;
    char *const compiler = pm_arena_strdup(w->arena, chosen == NULL ? "cc" : chosen);
    char *const library = pm_arena_printf(w->arena, "%s/%s.so", w->folder, name);
    char *const one = pm_arena_printf(w->arena, "%s/%s.c", w->folder, name);
    char *const two =
        pm_arena_printf(w->arena, w->version == 2 ? "%s/fmi2.c" : "%s/fmi3.c", w->folder);
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    char shared[] = "-shared", position[] = "-fPIC", hidden[] = "-fvisibility=hidden";
    char standard[] = "-std=c99", fast[] = "-O3", output[] = "-o", math[] = "-lm";
    char *argv[] = {compiler, standard, fast, position, hidden, shared,
                    output,   library,  one,  two,      math,   NULL};
    int code;
    *compiled = uname(&machine) == 0 && pm_child_run(argv, false, &code) == 0 && code == 0;
    if (!*compiled) {
        return PM_OK;
    }
    const char *plain = pm_arena_printf(w->arena, "%s.so", name);
    const char *packed =
        w->version == 2 && strcmp(machine.machine, "x86_64") == 0
            ? pm_arena_printf(w->arena, "binaries/linux64/%s.so", name)
            : pm_arena_printf(w->arena, "binaries/%s-linux/%s.so", machine.machine, name);
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    return pack(w, packed, plain);
}

static pm_status write_archive(fmu_writer *w, const char *path, bool *compiled) {
    FILE *file = NULL;
    PM_TRY(pm_files_create(&file, path, PM_FILES_ARCHIVE));
    w->archive = (archive){.file = file, .arena = w->arena};
    pm_status status = pack_all(w);
    if (status == PM_OK) {
        status = compile(w, compiled);
    }
    finish_archive(&w->archive);
    const bool bad = ferror(file) != 0;
    if ((fclose(file) != 0 || bad) && status == PM_OK) {
        status = pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(errno));
    }
    if (status != PM_OK) {
        unlink(path);
    }
    return status;
}

// Finds the value references, the names and the values at the start.
static pm_status open_writer(fmu_writer *w) {
    const pm_physics *physics = &w->scene->physics;
    fmu_references *r = &w->reference;
    r->state = 1;
    r->derivative = r->state + physics->nz;
    r->input = r->derivative + physics->nz;
    r->energy = r->input + physics->nprescribed;
    r->entropy = r->energy + physics->nsubsystem;
    r->flux = r->entropy + physics->nsubsystem;
    r->slope = r->flux + 4 * physics->nport;
    r->reaction = r->slope + 2 * physics->nz;
    r->departure = r->reaction + physics->nprescribed / 3;
    r->ledger = r->departure + 1;
    r->guard = r->ledger + LEDGER;
    r->end = r->guard + 1;
    PM_TRY(pm_scene_variable_names(&w->names, w->scene, w->arena));
    w->first = pm_arena_array(w->arena, (size_t)physics->nprescribed, sizeof *w->first);
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    if (physics->nprescribed > 0) {
        pm_boundary_input_at(&w->setup->boundary_input, 0, 0, w->first);
    }
    return add_variables(w);
}

pm_status pm_export_fmu(const pm_setup *setup, int version, const char *author, const char *path,
                        bool *compiled) {
    const char *base = getenv("TMPDIR");
    pm_arena arena = {0};
    fmu_writer w = {.version = version,
                    .author = author,
                    .setup = setup,
                    .scene = setup->scene,
                    .arena = &arena};
    pm_status status;
    *compiled = false;
    char *folder = pm_arena_printf(&arena, "%s/portmet-fmu-XXXXXX",
                                   base != NULL && base[0] != '\0' ? base : "/tmp");
    PM_TRY_DONE(open_writer(&w));
    w.folder = mkdtemp(folder);
    PM_TRY_DONE(w.folder == NULL
                    ? pm_fail(PM_EFILE, "%s: cannot be made: %s", folder, strerror(errno))
                    : PM_OK);
    PM_TRY_DONE(pm_export_c(setup, w.folder));
    status = write_archive(&w, path, compiled);
done:
    // The temporary folder and all that this file has put there are removed.
    for (int i = 0; w.folder != NULL && i < NFILE + 3; ++i) {
        static const char *const suffixes[] = {".c", ".h", ".so"};
        char plain[PATH_MAX];
        snprintf(plain, sizeof plain, "%s/%s%s", w.folder,
                 i < NFILE ? files[i].name : setup->scene->name,
                 i < NFILE ? "" : suffixes[i - NFILE]);
        unlink(plain);
    }
    if (w.folder != NULL) {
        rmdir(w.folder);
    }
    pm_arena_free(&arena);
    return status;
}
