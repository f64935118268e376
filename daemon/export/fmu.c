// Writes a scene as an FMU: fills in its texts (folder text) in a temporary folder, compiles the
// sources there, and packs all of it. States are outputs, values that follow a column or are live
// are inputs, other prescribed values are parameters, and energies, entropies and fluxes are
// outputs. Every port is a terminal.
#include "export/fmu.h"

#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "base/child.h"
#include "base/files.h"
#include "base/template.h"
#include "base/unit.h"
#include "export/archive.h"
#include "export/source.h"
#include "library/names.h"

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

static const struct {
    const char *folder, *name; // in the archive
    const char *const *text;
} files[] = {
    {"sources/", "model.h", pm_fmu_glue_text},
    {"sources/", "fmi3.h", pm_fmu_types_text},
    {"sources/", "fmi3.c", pm_fmu_interface_text},
    {"sources/", "fmi3_state.c", pm_fmu_state_text},
    {"sources/", "fmi3_unused.c", pm_fmu_unused_text},
    {"sources/", "buildDescription.xml", pm_fmu_build_text},
    {"", "modelDescription.xml", pm_fmu_model_text},
    {"terminalsAndIcons/", "terminalsAndIcons.xml", pm_fmu_terminals_text},
};
enum { NFILE = sizeof files / sizeof files[0] };

#define OUT_OF_MEMORY "an FMU" // what there was no memory for
#define ABILITIES                                                  \
    "canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\" " \
    "providesDirectionalDerivatives=\"true\""

static const char *const fluxes[4] = {"energy_flux_a", "entropy_flux_a", "energy_flux_b",
                                      "entropy_flux_b"};

// The value references of an FMU (fmi/fmi3.c). Each member is the reference of the first variable
// of its kind; the others follow it. The reference 0 is the time.
typedef struct fmu_references {
    int state, derivative, input, energy, entropy, flux, end;
} fmu_references;

typedef struct fmu_writer {
    const pm_setup *setup;
    const pm_scene *scene;
    pm_arena *arena;
    fmu_references reference;
    pm_scene_variables names;
    const char **rate_unit; // [nz] of the derivatives of the states
    double *first;          // [nprescribed] values of the boundary inputs at the start
    const char *folder;     // temporary
    pm_archive archive;
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

// Reads a unit X, or one of the forms that library/names.c and this file give to units of
// derivatives: "(X)/s", "J/(X)" and "J/K/(X)".
static pm_unit read_unit(const char *name, pm_arena *arena) {
    const char *open = strchr(name, '('), *close = strrchr(name, ')');
    if (open == NULL || close == NULL || (open != name && strncmp(name, "J/", 2) != 0)) {
        return pm_unit_parse(name);
    }
    const char *inner = pm_arena_printf(arena, "%.*s", (int)(close - open - 1), open + 1);
    pm_unit unit = pm_unit_parse(inner == NULL ? "?" : inner);
    if (open == name) {
        --unit.power[PM_UNIT_S];
        return unit;
    }
    const pm_unit joule = pm_unit_parse(strncmp(name, "J/K/", 4) == 0 ? "J/K" : "J");
    for (int i = 0; i < PM_UNIT_BASES; ++i) {
        unit.power[i] = joule.power[i] - unit.power[i];
    }
    unit.factor = 1 / unit.factor;
    return unit;
}

// Writes each unit once: our own, those of the states, of their rates and of the inputs.
static void write_units(FILE *file, const void *context) {
    static const char *const ours[] = {"s", "J", "J/K", "W", "W/K"};
    static const char *const base[] = {"kg", "m", "s", "A", "K", "mol"};
    const fmu_writer *w = context;
    const int nz = w->scene->physics.nz, most = 5 + 2 * nz + w->scene->physics.nprescribed;
    const char **list = pm_arena_array(w->arena, (size_t)most, sizeof *list);
    int count = 0;
    for (int i = 0; i < most && list != NULL; ++i) {
        const int k = i - 5;
        const char *unit = i < 5        ? ours[i]
                           : k < nz     ? w->names.unit[k]
                           : k < 2 * nz ? w->rate_unit[k - nz]
                                        : w->names.input_unit[k - 2 * nz];
        int same = 0;
        while (same < count && strcmp(list[same], unit) != 0) {
            ++same;
        }
        if (same < count) {
            continue;
        }
        list[count++] = unit;
        const pm_unit read = read_unit(unit, w->arena);
        fputs("    <Unit name=\"", file);
        put_text(file, unit);
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

// --- variables ---

// Writes the beginning of a variable. In the standard's structured names a part between two dots
// that is no identifier, such as dE/dp, stands in quotes.
static void write_variable(FILE *file, const char *name, int reference, const char *attributes,
                           const char *unit) {
    fputs("    <Float64 name=\"", file);
    for (const char *part = name; part != NULL;) {
        const char *dot = strchr(part, '.');
        const int whole = dot == NULL ? (int)strlen(part) : (int)(dot - part);
        const int length = (int)strcspn(part, "[.");
        const char *quote = memchr(part, '/', (size_t)length) != NULL ? "'" : "";
        fprintf(file, "%s%.*s%s%.*s%s", quote, length, part, quote, whole - length, part + length,
                dot == NULL ? "" : ".");
        part = dot == NULL ? NULL : dot + 1;
    }
    fprintf(file, "\" valueReference=\"%d\" %s unit=\"", reference, attributes);
    put_text(file, unit);
    fputs("\"", file);
}

// Writes the variables: states and their derivatives; inputs; energies, entropies and fluxes.
static void write_variables(FILE *file, const void *context) {
    static const char output[] =
        "causality=\"output\" variability=\"continuous\" initial=\"calculated\"";
    const fmu_writer *w = context;
    const pm_physics *physics = &w->scene->physics;
    const fmu_references *r = &w->reference;
    for (int i = 0; i < physics->nz; ++i) {
        write_variable(file, w->names.name[i], r->state + i,
                       "causality=\"output\" variability=\"continuous\" initial=\"exact\"",
                       w->names.unit[i]);
        fprintf(file, " start=\"%.17g\"/>\n", w->setup->initial[i]);
    }
    for (int i = 0; i < physics->nz; ++i) {
        const char *name = pm_arena_printf(w->arena, "der(%s)", w->names.name[i]);
        write_variable(file, name == NULL ? "" : name, r->derivative + i,
                       "causality=\"local\" variability=\"continuous\" initial=\"calculated\"",
                       w->rate_unit[i]);
        fprintf(file, " derivative=\"%d\"/>\n", r->state + i);
    }
    // A value that follows a column or is live is an input; another one a parameter, unless it is
    // zero, where the co-energies that nobody prescribes are.
    for (int i = 0; i < physics->nprescribed; ++i) {
        const pm_boundary_input *b = &w->setup->boundary_input;
        const bool follows = b->column[i] != PM_BOUNDARY_INPUT_CONSTANT || b->live_id[i] >= 0;
        if (follows || w->first[i] != 0) {
            write_variable(file, w->names.input_name[i], r->input + i,
                           follows ? "causality=\"input\" variability=\"continuous\""
                                   : "causality=\"parameter\" variability=\"tunable\"",
                           w->names.input_unit[i]);
            fprintf(file, " start=\"%.17g\"/>\n", w->first[i]);
        }
    }
    for (int i = 0; i < 2 * physics->nsubsystem + 4 * physics->nport; ++i) {
        const int k = i - 2 * physics->nsubsystem; // of all fluxes
        const char *owner = k < 0 ? physics->subsystem[i / 2].name : physics->port[k / 4].name;
        const char *what = k >= 0 ? fluxes[k % 4] : i % 2 == 0 ? "energy" : "entropy";
        const char *unit = k >= 0 ? (k % 2 == 0 ? "W" : "W/K") : i % 2 == 0 ? "J" : "J/K";
        const int reference = k >= 0       ? r->flux + k
                              : i % 2 == 0 ? r->energy + i / 2
                                           : r->entropy + i / 2;
        const char *name = pm_arena_printf(w->arena, "%s.%s", owner, what);
        write_variable(file, name == NULL ? "" : name, reference, output, unit);
        fputs("/>\n", file);
    }
}

// Writes the references `first` to `end` - 1 as elements.
static void write_references(FILE *file, const char *element, int first, int end) {
    for (int i = first; i < end; ++i) {
        fprintf(file, "    <%s valueReference=\"%d\"/>\n", element, i);
    }
}

static void write_structure(FILE *file, const void *context) {
    const fmu_references *r = context;
    write_references(file, "Output", r->state, r->derivative);
    write_references(file, "Output", r->energy, r->end);
    write_references(file, "ContinuousStateDerivative", r->derivative, r->input);
    write_references(file, "InitialUnknown", r->derivative, r->input);
    write_references(file, "InitialUnknown", r->energy, r->end);
}

static void write_terminals(FILE *file, const void *context) {
    const pm_scene *scene = context;
    for (int i = 0; i < scene->physics.nport; ++i) {
        const pm_scene_port *port = &scene->physics.port[i];
        fprintf(file,
                "    <Terminal name=\"%s\" matchingRule=\"bus\" terminalKind=\"portmet.%s\" "
                "description=\"a: %s, b: %s\">\n",
                port->name, port->law, pm_scene_end_name(scene, port, 0),
                pm_scene_end_name(scene, port, 1));
        for (int k = 0; k < 4; ++k) {
            fprintf(file,
                    "      <TerminalMemberVariable variableName=\"%s.%s\" memberName=\"%s\" "
                    "variableKind=\"signal\"/>\n",
                    port->name, fluxes[k], fluxes[k]);
        }
        fputs("    </Terminal>\n", file);
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
    return whole ? pm_archive_add(&w->archive, name, bytes, (size_t)size)
                 : pm_fail(PM_EFILE, "%s: cannot be read", plain);
}

// Writes all files into the temporary folder and packs them.
static pm_status pack_all(fmu_writer *w) {
    const pm_physics *physics = &w->scene->physics;
    const char *const h = pm_arena_printf(w->arena, "%.17g", physics->dt / physics->substeps);
    const char *const dt = pm_arena_printf(w->arena, "%.17g", physics->dt);
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
        {"%STRUCTURE%", .write = write_structure, .context = &w->reference},
        {"%IF_PORTS%", .text = physics->nport > 0 ? "" : NULL},
        {"%TERMINALS%", .write = write_terminals, .context = w->scene},
    };
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    for (int i = 0; i < 2; ++i) {
        const char *plain = pm_arena_printf(w->arena, "%s.%c", w->scene->name, "ch"[i]);
        const char *name = pm_arena_printf(w->arena, "sources/%s", plain);
        PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
        PM_TRY(pack(w, name, plain));
    }
    for (int i = 0; i < NFILE; ++i) {
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
    char *const two = pm_arena_printf(w->arena, "%s/fmi3.c", w->folder);
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
        pm_arena_printf(w->arena, "binaries/%s-linux/%s.so", machine.machine, name);
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    return pack(w, packed, plain);
}

static pm_status write_archive(fmu_writer *w, const char *path, bool *compiled) {
    FILE *file = NULL;
    PM_TRY(pm_files_create(&file, path));
    w->archive = (pm_archive){.file = file, .arena = w->arena};
    pm_status status = pack_all(w);
    if (status == PM_OK) {
        status = compile(w, compiled);
    }
    pm_archive_finish(&w->archive);
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
    r->end = r->flux + 4 * physics->nport;
    PM_TRY(pm_scene_variable_names(&w->names, w->scene, w->arena));
    w->first = pm_arena_array(w->arena, (size_t)physics->nprescribed, sizeof *w->first);
    w->rate_unit = pm_arena_array(w->arena, (size_t)physics->nz, sizeof *w->rate_unit);
    PM_TRY(pm_arena_status(w->arena, OUT_OF_MEMORY));
    for (int i = 0; i < physics->nz; ++i) {
        w->rate_unit[i] = pm_arena_printf(w->arena, "(%s)/s", w->names.unit[i]);
    }
    if (physics->nprescribed > 0) {
        pm_boundary_input_at(&w->setup->boundary_input, 0, 0, w->first);
    }
    return pm_arena_status(w->arena, OUT_OF_MEMORY);
}

pm_status pm_export_fmu(const pm_setup *setup, const char *path, bool *compiled) {
    const char *base = getenv("TMPDIR");
    pm_arena arena = {0};
    fmu_writer w = {.setup = setup, .scene = setup->scene, .arena = &arena};
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
