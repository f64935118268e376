// Writes the source of programs, and compiles and loads it.
#include "graph/compile.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "base/child.h"
#include "base/digest.h"
#include "graph/node.h"
#include "graph/source.h"

#define MOST_TEXT 300000 // bytes of a program's source: more takes long to compile
#define PATH_SIZE 4096
#define RUNS 20 // of a program whose time is measured

// A program, and its function in the source. Equal programs share one.
typedef struct compiled {
    pm_program *program;
    const char *text;
    int function;
    struct compiled *older;
} compiled;

struct pm_compiler {
    pm_arena arena;
    compiled *newest;
    int nfunction;
    char *text; // of all functions
    size_t size;
    FILE *file; // which writes it
};

pm_status pm_compiler_open(pm_compiler **compiler) {
    pm_compiler *c = calloc(1, sizeof *c);
    if (c == NULL || (c->file = open_memstream(&c->text, &c->size)) == NULL) {
        free(c);
        return pm_fail(PM_ENOMEM, "out of memory for the source of programs");
    }
    pm_source_prelude(c->file);
    *compiler = c;
    return PM_OK;
}

void pm_compiler_close(pm_compiler *compiler) {
    if (compiler != NULL) {
        if (compiler->file != NULL) {
            fclose(compiler->file);
        }
        free(compiler->text);
        PM_DELETE(compiler);
    }
}

// --- sources ---

// Writes the functions of a program: ITEM of one item, and KERNEL of all lanes.
static pm_status write_program(FILE *file, pm_arena *arena, pm_program *p, const pm_graph *g) {
    const int nnode = pm_graph_size(g), lanes = p->capacity;
    const double **known = pm_arena_array(arena, (size_t)nnode, sizeof *known);
    pm_source_argument *argument =
        pm_arena_array(arena, (size_t)(nnode + p->noutput), sizeof *argument);
    int nin = 0;
    PM_TRY(pm_arena_status(arena, "the source of a program"));
    for (pm_node x = 0; x < nnode; ++x) {
        const pm_graph_node *node = pm_graph_node_at(g, x);
        const int size = node->shape.rows * node->shape.cols;
        // The numbers of fixed nodes of lanes are the same in each, and are computed.
        const bool once = !node->shape.batched || lanes == 1;
        known[x] = p->needed[x] && p->fixed[x] && once ? p->value[x] : NULL;
        if (p->needed[x] && node->op == PM_OP_INPUT) {
            argument[nin++] = (pm_source_argument){pm_arena_printf(arena, "i%d", x), x, size,
                                                   lanes > 1 && !once ? lanes : 0};
        }
    }
    for (int i = 0; i < p->noutput; ++i) {
        const pm_shape shape = pm_graph_node_at(g, p->output[i])->shape;
        argument[nin + i] =
            (pm_source_argument){pm_arena_printf(arena, "o%d", i), p->output[i],
                                 shape.rows * shape.cols, lanes > 1 && shape.batched ? lanes : 0};
    }
    PM_TRY(pm_arena_status(arena, "the source of a program"));
    fputs("static inline __attribute__((always_inline)) void ITEM", file);
    PM_TRY(pm_source_write(file, g, known, nin, argument, p->noutput, argument + nin));
    fputs("void KERNEL(double *m) {\n", file);
    if (lanes > 1) {
        fprintf(file, "#pragma omp simd\n    for (int l = 0; l < %d; ++l) {\n", lanes);
    }
    fputs("    ITEM(", file);
    for (int i = 0; i < nin + p->noutput; ++i) {
        fprintf(file, "%sm + %td%s", i == 0 ? "" : ", ", p->value[argument[i].node] - p->memory,
                argument[i].step > 0 ? " + l" : "");
    }
    fprintf(file, ");\n%s}\n", lanes > 1 ? "    }\n" : "");
    return PM_OK;
}

pm_status pm_compiler_add(pm_compiler *compiler, pm_program *program, const pm_graph *graph) {
    if (compiler == NULL || program == NULL) {
        return PM_OK;
    }
    pm_program_prepare(program); // computes what depends on weights
    char *text = NULL;
    size_t size = 0;
    pm_arena scratch = {0};
    FILE *file = open_memstream(&text, &size);
    pm_status status = file == NULL ? pm_fail(PM_ENOMEM, "out of memory for the source of programs")
                                    : write_program(file, &scratch, program, graph);
    if (file != NULL && fclose(file) != 0 && status == PM_OK) {
        status = pm_fail(PM_ENOMEM, "out of memory for the source of programs");
    }
    if (status == PM_OK && size <= MOST_TEXT) {
        compiled *new = pm_arena_alloc(&compiler->arena, sizeof *new);
        const char *kept = pm_arena_strdup(&compiler->arena, text);
        status = pm_arena_status(&compiler->arena, "the source of programs");
        const compiled *same = compiler->newest;
        while (status == PM_OK && same != NULL && strcmp(same->text, text) != 0) {
            same = same->older;
        }
        if (status == PM_OK && same == NULL) {
            const int n = compiler->nfunction++;
            fprintf(compiler->file, "\n#define ITEM item%d\n#define KERNEL kernel%d\n%s", n, n,
                    text);
            fputs("#undef ITEM\n#undef KERNEL\n", compiler->file);
        }
        if (status == PM_OK) {
            const int function = same == NULL ? compiler->nfunction - 1 : same->function;
            *new = (compiled){program, kept, function, compiler->newest};
            compiler->newest = new;
        }
    }
    free(text);
    pm_arena_free(&scratch);
    return status == PM_ECONFIG ? PM_OK : status; // it needs BLAS
}

// --- the cache ---

// Returns the digest of a file's bytes; 0: it cannot be read, is no file, or is not this user's
// alone.
static uint64_t digest_file(const char *path, char **content) {
    struct stat s;
    uint64_t digest = 0;
    const int file = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    if (file >= 0 && fstat(file, &s) == 0 && S_ISREG(s.st_mode) && s.st_uid == geteuid() &&
        (s.st_mode & (S_IWGRP | S_IWOTH)) == 0) {
        char *bytes = calloc((size_t)s.st_size + 1, 1);
        if (bytes != NULL && read(file, bytes, (size_t)s.st_size) == s.st_size) {
            digest = PM_DIGEST_INIT;
            for (off_t i = 0; i < s.st_size; ++i) {
                digest = pm_digest_integer(digest, bytes[i]);
            }
        }
        if (content != NULL && digest != 0) {
            *content = bytes;
        } else {
            free(bytes);
        }
    }
    if (file >= 0) {
        close(file);
    }
    return digest;
}

// Finds or makes the folder of compiled code.
static pm_status find_folder(char *folder) {
    const char *cache = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    const bool given = cache != NULL && cache[0] == '/';
    struct stat s;
    if (!given && (home == NULL || home[0] != '/')) {
        return pm_fail(PM_EFILE, "compiled code has no folder: neither XDG_CACHE_HOME nor HOME is "
                                 "set");
    }
    snprintf(folder, PATH_SIZE, "%s%s", given ? cache : home, given ? "" : "/.cache");
    (void)mkdir(folder, 0700);
    strncat(folder, "/portmet", PATH_SIZE - strlen(folder) - 1);
    (void)mkdir(folder, 0700);
    return lstat(folder, &s) == 0 && S_ISDIR(s.st_mode) && s.st_uid == geteuid() &&
                   (s.st_mode & (S_IWGRP | S_IWOTH)) == 0
               ? PM_OK
               : pm_fail(PM_EFILE,
                         "%s: compiled code is kept in a folder that belongs to this user, and to "
                         "which nobody else can write",
                         folder);
}

// Returns a digest of the compiler and of the processor for which it compiles.
static uint64_t digest_tools(const char *compiler) {
    char path[PATH_SIZE], line[PATH_SIZE];
    const char *at = getenv("PATH");
    uint64_t digest = pm_digest_text(PM_DIGEST_INIT, compiler);
    struct stat s;
    while (at != NULL) { // as execvp looks for it
        const size_t length = strcspn(at, ":");
        snprintf(path, sizeof path, "%.*s/%s", (int)length, at, compiler);
        at = at[length] == '\0' ? NULL : at + length + 1;
        if (stat(strchr(compiler, '/') != NULL ? compiler : path, &s) == 0) {
            digest = pm_digest_integer(digest, (int64_t)s.st_ino);
            digest = pm_digest_integer(digest, (int64_t)s.st_size);
            digest = pm_digest_integer(digest, (int64_t)s.st_mtime);
            at = NULL;
        }
    }
    FILE *file = fopen("/proc/cpuinfo", "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL && line[0] != '\n') {
        if (strncmp(line, "flags", 5) == 0 || strncmp(line, "model", 5) == 0) {
            digest = pm_digest_text(digest, line);
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return digest;
}

static pm_status write_text(const char *path, const char *head, const char *text) {
    const int descriptor = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    FILE *file = descriptor < 0 ? NULL : fdopen(descriptor, "w");
    bool written = file != NULL && fputs(head, file) >= 0 && fputs(text, file) >= 0;
    written = (file == NULL || fclose(file) == 0) && written;
    return written ? PM_OK : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

// Compiles the text, in a folder of its own, to the files CODE and SOURCE, which appear whole.
static pm_status build(const char *compiler, const char *folder, const char *code,
                       const char *source, const char *text) {
    char own[PATH_SIZE + 40], made[2][PATH_SIZE + 80], head[40];
    int exit_code = 0;
    pm_status status;
    snprintf(own, sizeof own, "%s/XXXXXX", folder);
    if (mkdtemp(own) == NULL) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    snprintf(made[0], sizeof made[0], "%s/code.so", own);
    snprintf(made[1], sizeof made[1], "%s/source.c", own);
    char *const argv[] = {(char *)compiler,
                          "-std=gnu11",
                          "-O3",
                          "-march=native",
                          "-ffp-contract=off",
                          "-fno-math-errno",
                          "-fopenmp-simd",
                          "-fno-trapping-math",
                          "-fPIC",
                          "-shared",
                          "-w",
                          "-o",
                          made[0],
                          made[1],
                          "-lm",
                          NULL};
    PM_TRY_DONE(write_text(made[1], "#include <math.h>\n", text));
    const int error = pm_child_run(argv, true, &exit_code);
    if (error != 0) {
        status = pm_fail(PM_EFILE, "the C compiler %s: %s", compiler, strerror(error));
    } else if (exit_code != 0 || chmod(made[0], 0600) != 0) {
        status = pm_fail(PM_EFILE, "the C compiler %s failed", compiler);
    }
    PM_TRY_DONE(status);
    snprintf(head, sizeof head, "// %016llx\n", (unsigned long long)digest_file(made[0], NULL));
    (void)unlink(made[1]);
    PM_TRY_DONE(write_text(made[1], head, text));
    if (rename(made[0], code) != 0 || rename(made[1], source) != 0) {
        status = pm_fail(PM_EFILE, "%s: %s", code, strerror(errno));
    }
done:
    (void)unlink(made[0]);
    (void)unlink(made[1]);
    (void)rmdir(own);
    return status;
}

// Returns the least CPU time that a run takes, s.
static double time_of(pm_program *program) {
    double least = INFINITY;
    for (int i = 0; i < RUNS; ++i) {
        struct timespec begin, end;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
        pm_program_run_prepared(program, program->capacity);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
        least = fmin(least, (double)(end.tv_sec - begin.tv_sec) +
                                1e-9 * (double)(end.tv_nsec - begin.tv_nsec));
    }
    return least;
}

pm_status pm_compiler_link(pm_compiler *c) {
    char folder[PATH_SIZE], code[PATH_SIZE + 40], source[PATH_SIZE + 40];
    const char *compiler = getenv("CC");
    compiler = compiler == NULL || compiler[0] == '\0' ? "cc" : compiler;
    if (fflush(c->file) != 0) {
        return pm_fail(PM_ENOMEM, "out of memory for the source of programs");
    }
    PM_TRY(find_folder(folder));
    const uint64_t key = pm_digest_text(digest_tools(compiler), c->text);
    snprintf(code, sizeof code, "%s/%016llx.so", folder, (unsigned long long)key);
    snprintf(source, sizeof source, "%s/%016llx.c", folder, (unsigned long long)key);
    // Whether the cache has this source, and the code that was made from it.
    char *kept = NULL, head[40];
    snprintf(head, sizeof head, "// %016llx\n", (unsigned long long)digest_file(code, NULL));
    const bool is_kept = digest_file(source, &kept) != 0 &&
                         strncmp(kept, head, strlen(head)) == 0 &&
                         strcmp(kept + strlen(head), c->text) == 0;
    free(kept);
    if (!is_kept) {
        PM_TRY(build(compiler, folder, code, source, c->text));
    }
    void *library = dlopen(code, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        return pm_fail(PM_EFILE, "%s", dlerror());
    }
    for (const compiled *x = c->newest; x != NULL; x = x->older) {
        char name[40];
        snprintf(name, sizeof name, "kernel%d", x->function);
        void *symbol = dlsym(library, name);
        const double interpreted = x->program->capacity > 1 ? time_of(x->program) : INFINITY;
        memcpy(&x->program->kernel, &symbol, sizeof symbol); // as POSIX allows
        // Loops over lanes that the compiler cannot vectorise are slower than the instructions.
        if (symbol != NULL && x->program->capacity > 1 && time_of(x->program) > interpreted) {
            x->program->kernel = NULL;
        }
    }
    return PM_OK;
}
