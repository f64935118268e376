// States are outputs, values that follow a column or are live are inputs, other prescribed values
// are parameters, and energies, entropies and fluxes are outputs. Every port is a terminal.
#include "export/description.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "base/unit.h"
#include "library/names.h"

pm_fmu_references pm_fmu_references_of(const pm_scene *scene) {
    pm_fmu_references r = {.state = 1};
    r.derivative = r.state + scene->nz;
    r.input = r.derivative + scene->nz;
    r.energy = r.input + scene->nprescribed;
    r.entropy = r.energy + scene->nsubsystem;
    r.flux = r.entropy + scene->nsubsystem;
    return r;
}

const char *pm_fmu_token(const pm_setup *setup, pm_arena *arena) {
    return pm_arena_printf(arena, "{portmet-%s-%016" PRIx64 "}", PM_VERSION, setup->system->digest);
}

typedef struct xml_writer {
    FILE *file;
    const pm_setup *setup;
    const pm_scene *scene;
    pm_fmu_references reference;
    pm_scene_variables names;
    const double *first; // [nprescribed] values of the boundary inputs at the start
    pm_arena arena;
} xml_writer;

static pm_status open_writer(xml_writer *w, FILE *file, const pm_setup *setup) {
    *w = (xml_writer){.file = file, .setup = setup, .scene = setup->scene};
    w->reference = pm_fmu_references_of(w->scene);
    double *first = pm_arena_array(&w->arena, (size_t)w->scene->nprescribed, sizeof *first);
    if (first == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the description of an FMU");
    }
    if (w->scene->nprescribed > 0) {
        pm_boundary_input_at(&setup->boundary_input, 0, 0, first);
    }
    w->first = first;
    return pm_scene_variable_names(&w->names, w->scene, &w->arena);
}

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

static void begin(FILE *file) {
    fputs("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n", file);
}

// --- units ---

static bool is_listed(const char *const *list, int count, const char *text) {
    for (int i = 0; i < count; ++i) {
        if (strcmp(list[i], text) == 0) {
            return true;
        }
    }
    return false;
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

static void write_unit(FILE *file, const char *name, pm_arena *arena) {
    static const char *const base[] = {"kg", "m", "s", "A", "K", "mol"};
    const pm_unit unit = read_unit(name, arena);
    fputs("    <Unit name=\"", file);
    put_text(file, name);
    if (!unit.known) {
        fputs("\"/>\n", file); // such as J^0.5: the standard knows whole powers only
        return;
    }
    fputs("\"><BaseUnit", file);
    for (int i = 0; i < PM_UNIT_BASES; ++i) {
        if (unit.power[i] != 0) {
            fprintf(file, " %s=\"%d\"", base[i], unit.power[i]);
        }
    }
    if (unit.factor < 1 || unit.factor > 1) {
        fprintf(file, " factor=\"%.17g\"", unit.factor);
    }
    fputs("/></Unit>\n", file);
}

// The unit of a rate.
static const char *per_second(xml_writer *w, const char *unit) {
    const char *text = pm_arena_printf(&w->arena, "(%s)/s", unit);
    return text == NULL ? "" : text;
}

static pm_status write_units(xml_writer *w) {
    const int most = 2 * w->scene->nz + w->scene->nprescribed + 5;
    const char **list = pm_arena_array(&w->arena, (size_t)most, sizeof *list);
    if (list == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the description of an FMU");
    }
    static const char *const ours[] = {"s", "J", "J/K", "W", "W/K"};
    int count = 0;
    for (int i = 0; i < most; ++i) {
        const int k = i - 5, nz = w->scene->nz;
        const char *unit = i < 5        ? ours[i]
                           : k < nz     ? w->names.unit[k]
                           : k < 2 * nz ? per_second(w, w->names.unit[k - nz])
                                        : w->names.input_unit[k - 2 * nz];
        if (!is_listed(list, count, unit)) {
            list[count++] = unit;
        }
    }
    fputs("  <UnitDefinitions>\n", w->file);
    for (int i = 0; i < count; ++i) {
        write_unit(w->file, list[i], &w->arena);
    }
    fputs("  </UnitDefinitions>\n", w->file);
    return PM_OK;
}

// --- variables ---

// Writes the name of a variable. In the standard's structured names a part between two dots that is
// no identifier, such as dE/dp, stands in quotes.
static void put_name(FILE *file, const char *name) {
    for (const char *part = name; part != NULL;) {
        const char *dot = strchr(part, '.');
        const int whole = dot == NULL ? (int)strlen(part) : (int)(dot - part);
        const int length = (int)strcspn(part, "[.");
        const bool quoted = memchr(part, '/', (size_t)length) != NULL;
        fprintf(file, "%s%.*s%s%.*s%s", quoted ? "'" : "", length, part, quoted ? "'" : "",
                whole - length, part + length, dot == NULL ? "" : ".");
        part = dot == NULL ? NULL : dot + 1;
    }
}

static void write_variable(xml_writer *w, const char *name, int reference, const char *attributes,
                           const char *unit) {
    fputs("    <Float64 name=\"", w->file);
    put_name(w->file, name);
    fprintf(w->file, "\" valueReference=\"%d\" %s unit=\"", reference, attributes);
    put_text(w->file, unit);
    fputs("\"", w->file);
}

static void write_states(xml_writer *w) {
    for (int i = 0; i < w->scene->nz; ++i) {
        write_variable(w, w->names.name[i], w->reference.state + i,
                       "causality=\"output\" variability=\"continuous\" initial=\"exact\"",
                       w->names.unit[i]);
        fprintf(w->file, " start=\"%.17g\"/>\n", w->setup->initial[i]);
    }
    for (int i = 0; i < w->scene->nz; ++i) {
        const char *name = pm_arena_printf(&w->arena, "der(%s)", w->names.name[i]);
        write_variable(w, name == NULL ? "" : name, w->reference.derivative + i,
                       "causality=\"local\" variability=\"continuous\" initial=\"calculated\"",
                       per_second(w, w->names.unit[i]));
        fprintf(w->file, " derivative=\"%d\"/>\n", w->reference.state + i);
    }
}

// A value that follows a column or is live is an input; another one a parameter, unless it is zero,
// where the co-energies that nobody prescribes are.
static void write_inputs(xml_writer *w) {
    for (int i = 0; i < w->scene->nprescribed; ++i) {
        const pm_boundary_input *b = &w->setup->boundary_input;
        const bool follows = b->column[i] != PM_BOUNDARY_INPUT_CONSTANT || b->live_id[i] >= 0;
        if (follows || w->first[i] != 0) {
            write_variable(w, w->names.input_name[i], w->reference.input + i,
                           follows ? "causality=\"input\" variability=\"continuous\""
                                   : "causality=\"parameter\" variability=\"tunable\"",
                           w->names.input_unit[i]);
            fprintf(w->file, " start=\"%.17g\"/>\n", w->first[i]);
        }
    }
}

static void write_output(xml_writer *w, const char *owner, const char *what, int reference,
                         const char *unit) {
    const char *name = pm_arena_printf(&w->arena, "%s.%s", owner, what);
    write_variable(w, name == NULL ? "" : name, reference,
                   "causality=\"output\" variability=\"continuous\" initial=\"calculated\"", unit);
    fputs("/>\n", w->file);
}

static const char *const fluxes[4] = {"energy_flux_a", "entropy_flux_a", "energy_flux_b",
                                      "entropy_flux_b"};

static void write_outputs(xml_writer *w) {
    for (int i = 0; i < w->scene->nsubsystem; ++i) {
        const char *owner = w->scene->subsystem[i].name;
        write_output(w, owner, "energy", w->reference.energy + i, "J");
        write_output(w, owner, "entropy", w->reference.entropy + i, "J/K");
    }
    for (int i = 0; i < w->scene->nport; ++i) {
        for (int k = 0; k < 4; ++k) {
            write_output(w, w->scene->port[i].name, fluxes[k], w->reference.flux + 4 * i + k,
                         k % 2 == 0 ? "W" : "W/K");
        }
    }
}

static void write_structure(xml_writer *w) {
    fputs("  <ModelStructure>\n", w->file);
    const pm_fmu_references r = w->reference;
    const int end = r.flux + 4 * w->scene->nport;
    for (int i = r.state; i < r.derivative; ++i) {
        fprintf(w->file, "    <Output valueReference=\"%d\"/>\n", i);
    }
    for (int i = r.energy; i < end; ++i) {
        fprintf(w->file, "    <Output valueReference=\"%d\"/>\n", i);
    }
    for (int i = r.derivative; i < r.input; ++i) {
        fprintf(w->file, "    <ContinuousStateDerivative valueReference=\"%d\"/>\n", i);
    }
    for (int i = r.derivative; i < end; ++i) {
        if (i < r.input || i >= r.energy) {
            fprintf(w->file, "    <InitialUnknown valueReference=\"%d\"/>\n", i);
        }
    }
    fputs("  </ModelStructure>\n", w->file);
}

static pm_status write_model(xml_writer *w) {
    const pm_scene *scene = w->scene;
    const char *token = pm_fmu_token(w->setup, &w->arena);
    static const char abilities[] = "canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\" "
                                    "providesDirectionalDerivatives=\"true\"";
    if (token == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the description of an FMU");
    }
    begin(w->file);
    fprintf(w->file,
            "<fmiModelDescription fmiVersion=\"3.0\" modelName=\"%s\" instantiationToken=\"%s\" "
            "generationTool=\"portmetd %s\" variableNamingConvention=\"structured\">\n"
            "  <ModelExchange modelIdentifier=\"%s\" %s/>\n"
            "  <CoSimulation modelIdentifier=\"%s\" %s canHandleVariableCommunicationStepSize="
            "\"true\" fixedInternalStepSize=\"%.17g\" hasEventMode=\"true\"/>\n",
            scene->name, token, PM_VERSION, scene->name, abilities, scene->name, abilities,
            scene->dt / scene->substeps);
    PM_TRY(write_units(w));
    fprintf(w->file,
            "  <DefaultExperiment startTime=\"0\" stopTime=\"%.17g\" stepSize=\"%.17g\"/>\n"
            "  <ModelVariables>\n    <Float64 name=\"time\" valueReference=\"0\" "
            "causality=\"independent\" variability=\"continuous\" unit=\"s\"/>\n",
            scene->dt * scene->steps, scene->dt);
    write_states(w);
    write_inputs(w);
    write_outputs(w);
    fputs("  </ModelVariables>\n", w->file);
    write_structure(w);
    fputs("</fmiModelDescription>\n", w->file);
    return PM_OK;
}

pm_status pm_fmu_model_description(FILE *file, const pm_setup *setup) {
    xml_writer w;
    pm_status status = open_writer(&w, file, setup);
    if (status == PM_OK) {
        status = write_model(&w);
    }
    pm_arena_free(&w.arena);
    return status;
}

pm_status pm_fmu_build_description(FILE *file, const pm_setup *setup) {
    begin(file);
    fprintf(file,
            "<fmiBuildDescription fmiVersion=\"3.0\">\n"
            "  <BuildConfiguration modelIdentifier=\"%s\">\n"
            "    <SourceFileSet language=\"C99\">\n"
            "      <SourceFile name=\"fmi3.c\"/>\n      <SourceFile name=\"%s.c\"/>\n"
            "    </SourceFileSet>\n    <Library name=\"m\" external=\"true\"/>\n"
            "  </BuildConfiguration>\n</fmiBuildDescription>\n",
            setup->scene->name, setup->scene->name);
    return PM_OK;
}

// --- terminals ---

static void write_member(FILE *file, const char *variable, const char *member) {
    fprintf(file,
            "      <TerminalMemberVariable variableName=\"%s.%s\" memberName=\"%s\" "
            "variableKind=\"signal\"/>\n",
            variable, member, member);
}

pm_status pm_fmu_terminals(FILE *file, const pm_setup *setup) {
    const pm_scene *scene = setup->scene;
    begin(file);
    fputs("<fmiTerminalsAndIcons fmiVersion=\"3.0\">\n", file);
    if (scene->nport > 0) {
        fputs("  <Terminals>\n", file);
    }
    for (int i = 0; i < scene->nport; ++i) {
        fprintf(file,
                "    <Terminal name=\"%s\" matchingRule=\"bus\" terminalKind=\"portmet.%s\" "
                "description=\"a: %s, b: %s\">\n",
                scene->port[i].name, scene->port[i].law,
                pm_scene_end_name(scene, &scene->port[i], 0),
                pm_scene_end_name(scene, &scene->port[i], 1));
        for (int k = 0; k < 4; ++k) {
            write_member(file, scene->port[i].name, fluxes[k]);
        }
        fputs("    </Terminal>\n", file);
    }
    fputs(scene->nport > 0 ? "  </Terminals>\n</fmiTerminalsAndIcons>\n"
                           : "</fmiTerminalsAndIcons>\n",
          file);
    return PM_OK;
}
