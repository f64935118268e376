// Writes one XDMF grid per state, made of hyperslabs of the field file's datasets.
#include "bodies/field/xdmf.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "base/files.h"
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

// Writes a vector at the nodes.
static void write_vector(const xdmf_writer *w, const char *name, const char *dataset, int width,
                         int first) {
    fprintf(w->file, "<Attribute Name=\"%s\" AttributeType=\"Vector\" Center=\"Node\">\n", name);
    write_columns(w, dataset, width, first, 3);
    fputs("</Attribute>\n", w->file);
}

// Writes `count` numbers for each node, which `function` computes of the six components of the
// stress in the given order.
static void write_function(const xdmf_writer *w, const char *name, const char *type,
                           const char *function, int count, const int order[6]) {
    fprintf(w->file,
            "<Attribute Name=\"%s\" AttributeType=\"%s\" Center=\"Node\">\n"
            "<DataItem ItemType=\"Function\" Function=\"%s\" Dimensions=\"%d %d\">\n",
            name, type, function, w->field->nnode, count);
    for (int i = 0; i < 6; ++i) {
        write_columns(w, "z", w->field->nvariable, w->stress + order[i], 1);
    }
    fputs("</DataItem>\n</Attribute>\n", w->file);
}

// Writes the grid of a state: mesh and attributes.
static void write_grid(const xdmf_writer *w) {
    // The field's order is xx yy zz xy xz yz; that of a symmetric tensor of XDMF is xx xy xz yy yz
    // zz.
    static const int own[6] = {0, 1, 2, 3, 4, 5}, tensor[6] = {0, 3, 4, 1, 5, 2};
    const pm_field *d = w->field;
    const int extent[2] = {d->nelement, 8};
    fprintf(w->file,
            "<Grid Name=\"body\" GridType=\"Uniform\">\n<Time Value=\"%.9g\"/>\n"
            "<Topology TopologyType=\"Hexahedron\" NumberOfElements=\"%d\">\n",
            d->t[w->time], d->nelement);
    write_dataset(w, "hexahedra", WHOLE, 2, extent);
    fputs("\n</Topology>\n<Geometry GeometryType=\"XYZ\">", w->file);
    if (w->q >= 0) {
        write_columns(w, "z", d->nvariable, w->q, 3);
    } else {
        write_reference(w);
    }
    fputs("</Geometry>\n", w->file);
    if (w->q >= 0) {
        fprintf(w->file,
                "<Attribute Name=\"u\" AttributeType=\"Vector\" Center=\"Node\">\n"
                "<DataItem ItemType=\"Function\" Function=\"$0 - $1\" Dimensions=\"%d 3\">\n",
                d->nnode);
        write_columns(w, "z", d->nvariable, w->q, 3);
        write_reference(w);
        fputs("</DataItem>\n</Attribute>\n", w->file);
    }
    if (w->v >= 0) {
        write_vector(w, "v", "z", d->nvariable, w->v);
    }
    if (w->stress >= 0) {
        write_function(w, "stress", "Tensor6", "JOIN($0, $1, $2, $3, $4, $5)", 6, tensor);
        write_function(w, "von Mises stress", "Scalar",
                       "sqrt(0.5 * (($0 - $1) * ($0 - $1) + ($1 - $2) * ($1 - $2) + ($2 - $0) * "
                       "($2 - $0)) + 3.0 * ($3 * $3 + $4 * $4 + $5 * $5))",
                       1, own);
    }
    write_vector(w, "force", "f", 3, 0);
    if (d->contact != NULL) {
        write_vector(w, "contact force", "contact_force", 3, 0);
    }
    fputs("</Grid>\n", w->file);
}

pm_status pm_xdmf_save(const pm_field *field, const char *path) {
    const char *slash = strrchr(path, '/'), *name = "";
    pm_arena arena = {0};
    pm_status status;
    if (field->nelement == 0) {
        return pm_fail(PM_EDATA, "%s: the field has no hexahedra to draw", path);
    }
    // The name without its folder, escaped for XML.
    for (const char *c = slash == NULL ? path : slash + 1; *c != '\0'; ++c) {
        name = *c == '&'   ? pm_arena_printf(&arena, "%s&amp;", name)
               : *c == '<' ? pm_arena_printf(&arena, "%s&lt;", name)
               : *c == '>' ? pm_arena_printf(&arena, "%s&gt;", name)
                           : pm_arena_printf(&arena, "%s%c", name, *c);
    }
    xdmf_writer w = {.field = field,
                     .data = name,
                     .q = pm_field_columns(field, "qx qy qz"),
                     .v = pm_field_columns(field, "vx vy vz"),
                     .stress = pm_field_columns(field, "sxx syy szz sxy sxz syz")};
    const char *to = pm_arena_printf(&arena, "%.*s.xdmf", (int)pm_path_stem(path), path);
    PM_TRY_DONE(pm_arena_status(&arena, "the XDMF file of %s", path));
    PM_TRY_DONE(pm_files_create(&w.file, to));
    fputs("<?xml version=\"1.0\"?>\n<Xdmf Version=\"2.0\">\n<Domain>\n", w.file);
    for (w.trajectory = 0; w.trajectory < field->ntrajectory; ++w.trajectory) {
        fprintf(
            w.file,
            "<Grid Name=\"trajectory %d\" GridType=\"Collection\" CollectionType=\"Temporal\">\n",
            w.trajectory);
        for (w.time = 0; w.time < field->ntime; ++w.time) {
            write_grid(&w);
        }
        fputs("</Grid>\n", w.file);
    }
    fputs("</Domain>\n</Xdmf>\n", w.file);
    const bool failed = ferror(w.file) != 0;
    if (fclose(w.file) != 0 || failed) {
        status = pm_fail(PM_EFILE, "%s: %s", to, strerror(errno));
    }
done:
    pm_arena_free(&arena);
    return status;
}
