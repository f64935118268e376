// Collects the files of an FMU in a temporary folder, compiles them there, and packs them.
#include "export/fmu.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "base/child.h"
#include "export/archive.h"
#include "export/description.h"
#include "export/fmu_text.h"
#include "export/header.h"
#include "export/source.h"

// One file: its name in the archive and in the temporary folder, and what writes it.
typedef struct fmu_file {
    const char *name, *plain;
    pm_status (*write)(FILE *file, const pm_setup *setup);
} fmu_file;

typedef struct packer {
    const pm_setup *setup;
    pm_arena arena;
    const char *folder; // temporary
    pm_archive archive;
} packer;

// --- what it writes itself ---

static pm_status write_glue(FILE *file, const pm_setup *setup) {
    pm_arena arena = {0};
    const pm_scene *scene = setup->scene;
    const char *token = pm_fmu_token(setup, &arena);
    fprintf(file,
            "// Tells fmi3.c which scene it serves.\n#include \"%s.h\"\n\n"
            "#define MODEL_NAME %s\n#define MODEL_TOKEN \"%s\"\n#define MODEL_DT %.17g\n"
            "#define MODEL_SUBSTEPS %d\n",
            scene->name, scene->name, token == NULL ? "" : token, scene->dt, scene->substeps);
    const pm_status status = token == NULL ? pm_fail(PM_ENOMEM, "out of memory") : PM_OK;
    pm_arena_free(&arena);
    return status;
}

static pm_status write_lines(FILE *file, const char *const *line) {
    for (; *line != NULL; ++line) {
        fputs(*line, file);
    }
    return PM_OK;
}

static pm_status write_types(FILE *file, const pm_setup *setup) {
    (void)setup;
    return write_lines(file, pm_fmu_types_text);
}

static pm_status write_interface(FILE *file, const pm_setup *setup) {
    (void)setup;
    return write_lines(file, pm_fmu_interface_text);
}

static pm_status write_state(FILE *file, const pm_setup *setup) {
    (void)setup;
    return write_lines(file, pm_fmu_state_text);
}

static pm_status write_unused(FILE *file, const pm_setup *setup) {
    (void)setup;
    return write_lines(file, pm_fmu_unused_text);
}

// --- packing ---

// Adds the temporary file `plain` to the archive as `name`.
static pm_status pack(packer *p, const char *name, const char *plain) {
    const char *path = pm_arena_printf(&p->arena, "%s/%s", p->folder, plain);
    FILE *file = path == NULL ? NULL : fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        return pm_fail(PM_EFILE, "%s: cannot be read: %s", plain, strerror(errno));
    }
    const long size = ftell(file);
    char *bytes = pm_arena_array(&p->arena, (size_t)size + 1, 1);
    rewind(file);
    const bool whole = bytes != NULL && fread(bytes, 1, (size_t)size, file) == (size_t)size;
    fclose(file);
    return whole ? pm_archive_add(&p->archive, name, bytes, (size_t)size)
                 : pm_fail(PM_EFILE, "%s: cannot be read", plain);
}

static pm_status write_and_pack(packer *p, const fmu_file *f) {
    const char *path = pm_arena_printf(&p->arena, "%s/%s", p->folder, f->plain);
    FILE *file = path == NULL ? NULL : fopen(path, "wb");
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be written: %s", f->plain, strerror(errno));
    }
    pm_status status = f->write(file, p->setup);
    if (fclose(file) != 0 && status == PM_OK) {
        status = pm_fail(PM_EFILE, "%s: cannot be written: %s", f->plain, strerror(errno));
    }
    return status == PM_OK ? pack(p, f->name, f->plain) : status;
}

static pm_status pack_all(packer *p) {
    const char *name = p->setup->scene->name;
    const char *source = pm_arena_printf(&p->arena, "%s.c", name);
    const char *header = pm_arena_printf(&p->arena, "%s.h", name);
    const char *in_source = pm_arena_printf(&p->arena, "sources/%s.c", name);
    const char *in_header = pm_arena_printf(&p->arena, "sources/%s.h", name);
    if (source == NULL || header == NULL || in_source == NULL || in_header == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an FMU");
    }
    const fmu_file files[] = {
        {in_source, source, pm_export_source},
        {in_header, header, pm_export_header},
        {"sources/model.h", "model.h", write_glue},
        {"sources/fmi3.h", "fmi3.h", write_types},
        {"sources/fmi3.c", "fmi3.c", write_interface},
        {"sources/fmi3_state.c", "fmi3_state.c", write_state},
        {"sources/fmi3_unused.c", "fmi3_unused.c", write_unused},
        {"sources/buildDescription.xml", "buildDescription.xml", pm_fmu_build_description},
        {"modelDescription.xml", "modelDescription.xml", pm_fmu_model_description},
        {"terminalsAndIcons/terminalsAndIcons.xml", "terminalsAndIcons.xml", pm_fmu_terminals},
    };
    for (size_t i = 0; i < sizeof files / sizeof files[0]; ++i) {
        PM_TRY(write_and_pack(p, &files[i]));
    }
    return PM_OK;
}

// --- the binary ---

// Compiles the sources into a library for this kind of machine, and packs it.
static pm_status compile(packer *p, bool *compiled) {
    const char *name = p->setup->scene->name;
    const char *chosen = getenv("CC");
    struct utsname machine;
    char *const compiler = pm_arena_strdup(&p->arena, chosen == NULL ? "cc" : chosen);
    char *const library = pm_arena_printf(&p->arena, "%s/%s.so", p->folder, name);
    char *const one = pm_arena_printf(&p->arena, "%s/%s.c", p->folder, name);
    char *const two = pm_arena_printf(&p->arena, "%s/fmi3.c", p->folder);
    if (compiler == NULL || library == NULL || one == NULL || two == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an FMU");
    }
    char shared[] = "-shared", position[] = "-fPIC", hidden[] = "-fvisibility=hidden";
    char standard[] = "-std=c99", fast[] = "-O3", output[] = "-o", math[] = "-lm";
    char *argv[] = {compiler, standard, fast, position, hidden, shared,
                    output,   library,  one,  two,      math,   NULL};
    int code;
    *compiled = uname(&machine) == 0 && pm_child_run(argv, false, &code) == 0 && code == 0;
    if (!*compiled) {
        return PM_OK;
    }
    const char *plain = pm_arena_printf(&p->arena, "%s.so", name);
    const char *packed =
        pm_arena_printf(&p->arena, "binaries/%s-linux/%s.so", machine.machine, name);
    return plain == NULL || packed == NULL ? pm_fail(PM_ENOMEM, "out of memory for an FMU")
                                           : pack(p, packed, plain);
}

// Removes the temporary folder and all that this file has put there.
static void clean(packer *p) {
    static const char *const suffixes[] = {".c", ".h", ".so"};
    static const char *const others[] = {"model.h",
                                         "fmi3.h",
                                         "fmi3.c",
                                         "fmi3_state.c",
                                         "fmi3_unused.c",
                                         "buildDescription.xml",
                                         "modelDescription.xml",
                                         "terminalsAndIcons.xml"};
    enum { SUFFIXES = sizeof suffixes / sizeof suffixes[0] };
    enum { OTHERS = sizeof others / sizeof others[0] };
    for (int i = 0; i < SUFFIXES + OTHERS; ++i) {
        const char *file =
            i < SUFFIXES ? pm_arena_printf(&p->arena, "%s/%s%s", p->folder, p->setup->scene->name,
                                           suffixes[i])
                         : pm_arena_printf(&p->arena, "%s/%s", p->folder, others[i - SUFFIXES]);
        if (file != NULL) {
            unlink(file);
        }
    }
    rmdir(p->folder);
}

static pm_status make(packer *p, const char *path, bool *compiled) {
    const char *base = getenv("TMPDIR");
    char *folder = pm_arena_printf(&p->arena, "%s/portmet-fmu-XXXXXX",
                                   base != NULL && base[0] != '\0' ? base : "/tmp");
    if (folder == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an FMU");
    }
    p->folder = mkdtemp(folder);
    if (p->folder == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be made: %s", folder, strerror(errno));
    }
    FILE *file = fopen(path, "wb");
    if (file == NULL) {
        const int error = errno;
        rmdir(folder);
        return pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(error));
    }
    p->archive = (pm_archive){.file = file, .arena = &p->arena};
    pm_status status = pack_all(p);
    if (status == PM_OK) {
        status = compile(p, compiled);
    }
    pm_archive_finish(&p->archive);
    const bool bad = ferror(file) != 0;
    if ((fclose(file) != 0 || bad) && status == PM_OK) {
        status = pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(errno));
    }
    if (status != PM_OK) {
        unlink(path);
    }
    clean(p);
    return status;
}

pm_status pm_export_fmu(const pm_setup *setup, const char *path, bool *compiled) {
    packer p = {.setup = setup};
    *compiled = false;
    PM_TRY(pm_export_check(setup->scene));
    const pm_status status = make(&p, path, compiled);
    pm_arena_free(&p.arena);
    return status;
}
