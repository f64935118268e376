// Writes the surfaces as quadrangles into a gnuplot script, which sorts them by depth.
#include "bodies/solid/picture.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/files.h"
#include "base/path.h"
#include "bodies/solid/surface.h"
#include "evaluate/gnuplot.h"

#define PASCAL_PER_UNIT 1e3 // the colours show kPa
#define PANEL_HEIGHT 440    // pixels

// --- states ---

// A body at the time to be drawn.
typedef struct drawn_body {
    const double *z;               // [nnode][nvariable]
    const struct drawn_body *from; // whose stress is subtracted; NULL: nothing is
    const pm_field *field;
    pm_placement placement; // in the picture
    int q, stress;          // first variables that are positions (-1: none), and stresses
    pm_surface surface;
} drawn_body;

// One panel, with the bodies that are drawn in it.
typedef struct panel {
    const drawn_body *body;
    int count, first; // the first one in the picture
} panel;

// Returns the index of the state nearest to a time.
static int nearest_state(const pm_field *field, double time) {
    int best = 0;
    for (int j = 1; j < field->ntime; ++j) {
        best = fabs(field->t[j] - time) < fabs(field->t[best] - time) ? j : best;
    }
    return best;
}

// The position [3] of a node in the picture, m.
static void position_of(const drawn_body *b, int node, double *global) {
    const double *own = b->q >= 0 ? b->z + (ptrdiff_t)node * b->field->nvariable + b->q
                                  : b->field->position + 3 * (ptrdiff_t)node;
    pm_placement_point(&b->placement, own, global);
}

static const double *stress_at(const drawn_body *b, int node) {
    return b->z + (ptrdiff_t)node * b->field->nvariable + b->stress;
}

// Returns the von Mises stress at a node, Pa.
static double von_mises(const drawn_body *b, int node) {
    double s[6];
    for (int k = 0; k < 6; ++k) {
        s[k] = stress_at(b, node)[k] - (b->from == NULL ? 0 : stress_at(b->from, node)[k]);
    }
    const double xy = s[0] - s[1], yz = s[1] - s[2], zx = s[2] - s[0];
    const double shear = s[3] * s[3] + s[4] * s[4] + s[5] * s[5];
    return sqrt((xy * xy + yz * yz + zx * zx) / 2 + 3 * shear);
}

// --- the script ---

// The ranges of all bodies: positions, m, and the highest von Mises stress, Pa.
typedef struct drawn_bounds {
    double low[3], high[3], stress;
} drawn_bounds;

static void widen(drawn_bounds *all, const drawn_body *b) {
    for (int node = 0; node < b->field->nnode; ++node) {
        double at[3];
        position_of(b, node, at);
        for (int d = 0; d < 3; ++d) {
            all->low[d] = fmin(all->low[d], at[d]);
            all->high[d] = fmax(all->high[d], at[d]);
        }
        all->stress = fmax(all->stress, von_mises(b, node));
    }
}

// Writes a text between single quotes.
static void write_quoted(FILE *file, const char *text) {
    fputc('\'', file);
    for (; *text != '\0'; ++text) {
        fputs(*text == '\'' ? "''" : (const char[]){*text, '\0'}, file);
    }
    fputc('\'', file);
}

// Writes a panel, with the names of its bodies in the title if `named`.
static void write_panel(FILE *file, const pm_picture *picture, const panel *p, const char *title,
                        bool named) {
    static const int order[4] = {0, 1, 3, 2};
    fputs("$surface << END\n", file);
    for (int i = 0; i < p->count; ++i) {
        const drawn_body *b = &p->body[i];
        // A quadrangle is a grid of two by two points. Two empty lines separate it from the next.
        for (int k = 0; k < 4 * b->surface.nface; ++k) {
            const int node = b->surface.face[k / 4].node[order[k % 4]];
            double at[3];
            position_of(b, node, at);
            fprintf(file, "%.5g %.5g %.5g %.4g\n%s", at[0], at[1], at[2],
                    von_mises(b, node) / PASCAL_PER_UNIT,
                    k % 4 == 3   ? "\n\n"
                    : k % 2 == 1 ? "\n"
                                 : "");
        }
    }
    fputs("END\n", file);
    fputs("set title ", file);
    write_quoted(file, title);
    for (int i = 0; i < p->count && named; ++i) {
        fputs(i > 0 ? ".', '." : ".", file);
        write_quoted(file, picture->title[p->first + i]);
    }
    fprintf(file, ".' trajectory %d, %.4g s' noenhanced\n", picture->trajectory[p->first],
            p->body->field->t[nearest_state(p->body->field, picture->time)]);
    fputs("splot $surface using 1:2:3:4 with pm3d\n", file);
}

// Writes the script. `error` [count] is work space.
static void write_script(FILE *file, const pm_picture *picture, int npanel, const panel *p,
                         drawn_body *error, const char *path) {
    const drawn_bounds none = {{DBL_MAX, DBL_MAX, DBL_MAX}, {-DBL_MAX, -DBL_MAX, -DBL_MAX}, 0};
    const int nall = npanel + picture->error;
    drawn_bounds all = none, of = none;
    for (int i = 0; i < picture->count; ++i) {
        widen(&all, &p->body[i]);
    }
    fprintf(file, "set terminal pngcairo size 1000,%d font 'DejaVu Sans,11' background 'white'\n",
            PANEL_HEIGHT * nall);
    fputs("set output ", file);
    write_quoted(file, path);
    for (int d = 0; d < 3; ++d) {
        fprintf(file, "\nset %crange [%.6g:%.6g]", "xyz"[d], all.low[d], all.high[d]);
    }
    fprintf(file,
            "\nset cbrange [0:%.4g]\nset cblabel 'von Mises stress, kPa'\n"
            "set palette defined (0 '#440154', 1 '#414487', 2 '#2a788e', 3 '#22a884', 4 '#7ad151', "
            "5 '#fde725')\n"
            "set pm3d depthorder corners2color mean border linecolor '#404040' linewidth 0.3\n"
            "set view 65, 30, 2.4\nset view equal xyz\nset xyplane 0\n"
            "unset border\nunset tics\nunset key\nset cbtics\n"
            "set lmargin 0\nset rmargin 0\nset bmargin 0\n"
            "set colorbox user origin 0.88, %g size 0.02, %g\n",
            fmax(all.stress, DBL_MIN * PASCAL_PER_UNIT) / PASCAL_PER_UNIT,
            picture->error ? 0.42 : 0.2, picture->error ? 0.5 : 0.6);
    if (nall > 1) {
        fprintf(file, "set multiplot layout %d,1\n", nall);
    }
    for (int i = 0; i < npanel; ++i) {
        write_panel(file, picture, &p[i], "", npanel > 1);
        fputs(i == 0 ? "unset colorbox\n" : "", file);
    }
    if (!picture->error) {
        return;
    }
    // The bodies of the second panel, coloured by the difference of the stresses, on a scale of its
    // own.
    for (int i = 0; i < p[1].count; ++i) {
        error[i] = p[1].body[i];
        error[i].from = &p[0].body[i];
        widen(&of, &error[i]);
    }
    fprintf(file,
            "set cbrange [0:%.4g]\nset cblabel 'error, kPa'\n"
            "set colorbox user origin 0.88, 0.06 size 0.02, 0.24\n",
            fmax(of.stress, DBL_MIN * PASCAL_PER_UNIT) / PASCAL_PER_UNIT);
    write_panel(file, picture, &(panel){error, p[1].count, p[1].first}, "error,", false);
}

pm_status pm_picture_draw(const pm_picture *picture, const char *path) {
    const size_t n = (size_t)picture->count;
    pm_arena arena = {0};
    const char *script = pm_arena_printf(&arena, "%.*s.gp", (int)pm_path_stem(path), path);
    drawn_body *bodies = pm_arena_array(&arena, n, sizeof *bodies);
    drawn_body *error = pm_arena_array(&arena, n, sizeof *error);
    panel *p = pm_arena_array(&arena, n, sizeof *p);
    bool together = true;
    int npanel = 0;
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "a picture"));
    if (strcmp(script, path) == 0) {
        status = pm_fail(PM_EUSAGE,
                         "%s: the script of the picture has this name; choose another one", path);
        goto done;
    }
    for (int i = 0; i < picture->count; ++i) {
        together = together && picture->field[i]->placed;
    }
    for (int i = 0; i < picture->count; ++i) {
        const pm_field *field = picture->field[i];
        const int trajectory = picture->trajectory[i];
        drawn_body *b = &bodies[i];
        *b = (drawn_body){.field = field,
                          .placement = together ? field->placement : PM_PLACEMENT_IDENTITY,
                          .q = pm_field_columns(field, "qx qy qz"),
                          .stress = pm_field_columns(field, "sxx syy szz sxy sxz syz")};
        if (field->hexahedron == NULL || field->nelement == 0 || b->stress < 0) {
            status = pm_fail(PM_EDATA,
                             "%s: the field has no mesh of hexahedra, or no stress to colour it by",
                             picture->title[i]);
            goto done;
        }
        if (trajectory < 0 || trajectory >= field->ntrajectory) {
            status = pm_fail(PM_EDATA, "%s: there is no trajectory %d, only %d of them",
                             picture->title[i], trajectory, field->ntrajectory);
            goto done;
        }
        b->z = pm_field_state(field, trajectory, nearest_state(field, picture->time));
        PM_TRY_DONE(pm_surface_find(&b->surface, field->nelement, field->hexahedron, &arena));
        // Bodies that are placed share a panel, but those beside have one of their own.
        if (i == 0 || !together || i == picture->count - picture->nbeside) {
            p[npanel++] = (panel){b, 0, i};
        }
        ++p[npanel - 1].count;
    }
    bool good = !picture->error || (npanel == 2 && p[0].count == p[1].count);
    for (int i = 0; picture->error && good && i < p[0].count; ++i) {
        good = p[0].body[i].field->nnode == p[1].body[i].field->nnode;
    }
    if (!good) {
        status = pm_fail(PM_EUSAGE,
                         "picture: --error: expected two fields of one body, or --beside with a "
                         "field of each body");
        goto done;
    }
    FILE *file = NULL;
    PM_TRY_DONE(pm_files_create(&file, script));
    write_script(file, picture, npanel, p, error, path);
    const bool failed = ferror(file) != 0;
    PM_TRY_DONE(fclose(file) != 0 || failed ? pm_fail(PM_EFILE, "%s: cannot be written", script)
                                            : PM_OK);
    status = pm_gnuplot_run(".", script);
done:
    pm_arena_free(&arena);
    return status;
}
