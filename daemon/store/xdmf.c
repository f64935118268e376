// Writes one XDMF grid per state, made of hyperslabs of the field file's datasets.
#include "store/xdmf.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "base/path.h"

typedef struct xdmf_writer {
    FILE *file;
    const pm_field *field;
    const char *data;     // name of the field file, escaped for XML
    int q, v, stress;     // first column of each group of variables; -1: absent
    int trajectory, time; // of the grid being written
} xdmf_writer;

// --- data items ---

// Writes a data item for a whole dataset [extent[0]]...[extent[rank - 1]].
static void write_dataset(const xdmf_writer *w, const char *name, const char *type, int rank,
                          const int *extent) {
    fprintf(w->file, "<DataItem Format=\"HDF\" %s Dimensions=\"", type);
    for (int i = 0; i < rank; ++i) {
        fprintf(w->file, "%s%d", i > 0 ? " " : "", extent[i]);
    }
    fprintf(w->file, "\">%s:/%s</DataItem>", w->data, name);
}

#define REAL "NumberType=\"Float\" Precision=\"8\""
#define WHOLE "NumberType=\"Int\" Precision=\"4\""

// Writes a data item for columns [first, first + count) of the grid's state in a dataset
// [trajectory][time][node][width]. ParaView compares the beginnings of two data items to tell
// whether a geometry has changed; the comment makes them differ.
static void write_columns(const xdmf_writer *w, const char *name, int width, int first, int count) {
    const pm_field *d = w->field;
    const int extent[4] = {d->ntrajectory, d->ntime, d->nnode, width};
    fprintf(w->file,
            "<DataItem ItemType=\"HyperSlab\" Dimensions=\"%d %d\"><!-- %d %d --><DataItem "
            "Dimensions=\"3 4\" Format=\"XML\">%d %d 0 %d 1 1 1 1 1 1 %d %d</DataItem>",
            d->nnode, count, w->trajectory, w->time, w->trajectory, w->time, first, d->nnode,
            count);
    write_dataset(w, name, REAL, 4, extent);
    fputs("</DataItem>\n", w->file);
}

static void write_reference(const xdmf_writer *w) {
    const int extent[2] = {w->field->nnode, 3};
    write_dataset(w, "node_position_reference", REAL, 2, extent);
}

// --- attributes ---

static void open_attribute(const xdmf_writer *w, const char *name, const char *type) {
    fprintf(w->file, "<Attribute Name=\"%s\" AttributeType=\"%s\" Center=\"Node\">\n", name, type);
}

static void close_attribute(const xdmf_writer *w) {
    fputs("</Attribute>\n", w->file);
}

static void open_function(const xdmf_writer *w, const char *function, int count) {
    fprintf(w->file, "<DataItem ItemType=\"Function\" Function=\"%s\" Dimensions=\"%d %d\">\n",
            function, w->field->nnode, count);
}

static void close_function(const xdmf_writer *w) {
    fputs("</DataItem>\n", w->file);
}

static void write_displacement(const xdmf_writer *w) {
    open_attribute(w, "u", "Vector");
    open_function(w, "$0 - $1", 3);
    write_columns(w, "z", w->field->nvariable, w->q, 3);
    write_reference(w);
    close_function(w);
    close_attribute(w);
}

static void write_vector(const xdmf_writer *w, const char *name, const char *dataset, int width,
                         int first) {
    open_attribute(w, name, "Vector");
    write_columns(w, dataset, width, first, 3);
    close_attribute(w);
}

// The field's order is xx yy zz xy xz yz; that of a symmetric tensor of XDMF is xx xy xz yy yz zz.
static void write_stress(const xdmf_writer *w) {
    static const int order[6] = {0, 3, 4, 1, 5, 2};
    open_attribute(w, "stress", "Tensor6");
    open_function(w, "JOIN($0, $1, $2, $3, $4, $5)", 6);
    for (int i = 0; i < 6; ++i) {
        write_columns(w, "z", w->field->nvariable, w->stress + order[i], 1);
    }
    close_function(w);
    close_attribute(w);
}

static void write_von_mises(const xdmf_writer *w) {
    open_attribute(w, "von Mises stress", "Scalar");
    open_function(w,
                  "sqrt(0.5 * (($0 - $1) * ($0 - $1) + ($1 - $2) * ($1 - $2) + ($2 - $0) * "
                  "($2 - $0)) + 3.0 * ($3 * $3 + $4 * $4 + $5 * $5))",
                  1);
    for (int i = 0; i < 6; ++i) {
        write_columns(w, "z", w->field->nvariable, w->stress + i, 1);
    }
    close_function(w);
    close_attribute(w);
}

// --- grids ---

static void write_mesh(const xdmf_writer *w) {
    const pm_field *d = w->field;
    const int extent[2] = {d->nelement, 8};
    fprintf(w->file, "<Topology TopologyType=\"Hexahedron\" NumberOfElements=\"%d\">\n",
            d->nelement);
    write_dataset(w, "hexahedra", WHOLE, 2, extent);
    fputs("\n</Topology>\n<Geometry GeometryType=\"XYZ\">", w->file);
    if (w->q >= 0) {
        write_columns(w, "z", d->nvariable, w->q, 3);
    } else {
        write_reference(w);
    }
    fputs("</Geometry>\n", w->file);
}

static void write_grid(const xdmf_writer *w) {
    fprintf(w->file, "<Grid Name=\"body\" GridType=\"Uniform\">\n<Time Value=\"%.9g\"/>\n",
            w->field->t[w->time]);
    write_mesh(w);
    if (w->q >= 0) {
        write_displacement(w);
    }
    if (w->v >= 0) {
        write_vector(w, "v", "z", w->field->nvariable, w->v);
    }
    if (w->stress >= 0) {
        write_stress(w);
        write_von_mises(w);
    }
    write_vector(w, "force", "f", 3, 0);
    if (w->field->contact != NULL) {
        write_vector(w, "contact force", "contact_force", 3, 0);
    }
    fputs("</Grid>\n", w->file);
}

static void write_all(xdmf_writer *w) {
    fputs("<?xml version=\"1.0\"?>\n<Xdmf Version=\"2.0\">\n<Domain>\n", w->file);
    for (w->trajectory = 0; w->trajectory < w->field->ntrajectory; ++w->trajectory) {
        fprintf(
            w->file,
            "<Grid Name=\"trajectory %d\" GridType=\"Collection\" CollectionType=\"Temporal\">\n",
            w->trajectory);
        for (w->time = 0; w->time < w->field->ntime; ++w->time) {
            write_grid(w);
        }
        fputs("</Grid>\n", w->file);
    }
    fputs("</Domain>\n</Xdmf>\n", w->file);
}

// --- files ---

// Returns the name without its folder, escaped for XML; NULL: out of memory.
static const char *escape_name(const char *path, pm_arena *arena) {
    const char *slash = strrchr(path, '/'), *escaped = "";
    for (const char *c = slash == NULL ? path : slash + 1; *c != '\0' && escaped != NULL; ++c) {
        escaped = *c == '&'   ? pm_arena_printf(arena, "%s&amp;", escaped)
                  : *c == '<' ? pm_arena_printf(arena, "%s&lt;", escaped)
                  : *c == '>' ? pm_arena_printf(arena, "%s&gt;", escaped)
                              : pm_arena_printf(arena, "%s%c", escaped, *c);
    }
    return escaped;
}

static const char *xdmf_path(const char *path, pm_arena *arena) {
    return pm_arena_printf(arena, "%.*s.xdmf", (int)pm_path_stem(path), path);
}

static pm_status save(xdmf_writer *w, const char *path) {
    w->file = fopen(path, "w");
    if (w->file == NULL) {
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    write_all(w);
    const bool failed = ferror(w->file) != 0;
    return fclose(w->file) != 0 || failed ? pm_fail(PM_EFILE, "%s: %s", path, strerror(errno))
                                          : PM_OK;
}

pm_status pm_xdmf_save(const pm_field *field, const char *path) {
    pm_arena arena = {NULL};
    pm_status status = PM_ENOMEM;
    const char *to = xdmf_path(path, &arena);
    xdmf_writer w = {.field = field,
                     .data = escape_name(path, &arena),
                     .q = pm_field_columns(field, "qx qy qz"),
                     .v = pm_field_columns(field, "vx vy vz"),
                     .stress = pm_field_columns(field, "sxx syy szz sxy sxz syz")};
    if (field->nelement == 0) {
        status = pm_fail(PM_EDATA, "%s: the field has no hexahedra to draw", path);
    } else if (to == NULL || w.data == NULL) {
        status = pm_fail(PM_ENOMEM, "%s: out of memory", path);
    } else {
        status = save(&w, to);
    }
    pm_arena_free(&arena);
    return status;
}
