// Loads rows and random patches of nodes.
#include "truth/beam_load.h"

#include <assert.h>
#include <math.h>
#include <string.h>

// The smallest distance from the clamp to the centre of a patch, relative to the largest one.
static const double nearest = 0.4;

// Returns the node of a face at indices i along the beam and j across.
static int face_node(const pm_beam_mesh *mesh, int face, int i, int j) {
    const int top = face < 2;
    return face % 2 == 0 ? pm_beam_mesh_node(mesh, i, top ? mesh->count[1] : 0, j)
                         : pm_beam_mesh_node(mesh, i, j, top ? mesh->count[2] : 0);
}

// Return the axis normal to a face, the axis across the beam within the face, and the sign with
// which the normal axis points into the beam.
static int axis_in(int face) {
    return 1 + face % 2;
}
static int axis_across(int face) {
    return 2 - face % 2;
}
static double sign_in(int face) {
    return face < 2 ? -1 : 1;
}

static void add_node(pm_beam_load *load, int node) {
    assert(load->nnode < PM_BEAM_MAX_LOADED);
    load->node[load->nnode++] = node;
}

void pm_beam_load_row(pm_beam_load *load, const pm_beam_mesh *mesh, int face, int position,
                      double force, double ramp) {
    *load = (pm_beam_load){.time = {0, ramp, ramp, ramp}, .fraction = {0, 1, 1, 1}};
    for (int j = 0; j <= mesh->count[axis_across(face)]; ++j) {
        add_node(load, face_node(mesh, face, mesh->count[0] - position, j));
    }
    load->force[axis_in(face)] = sign_in(face) * force;
}

// Draws a number from a range uniformly.
static double draw_between(pm_rng *rng, const double range[2]) {
    return range[0] + (range[1] - range[0]) * pm_rng_uniform(rng);
}

// Loads the nodes of a face that lie in a rectangle, or the one nearest to its centre if none does.
static void add_rectangle(pm_beam_load *load, const pm_beam_mesh *mesh, int face,
                          const double centre[2], const double half[2]) {
    const int across = axis_across(face);
    const double spacing[2] = {mesh->size[0] / mesh->count[0],
                               mesh->size[across] / mesh->count[across]};
    for (int i = 1; i <= mesh->count[0]; ++i) {
        for (int j = 0; j <= mesh->count[across]; ++j) {
            if (fabs(i * spacing[0] - centre[0]) <= half[0] &&
                fabs(j * spacing[1] - centre[1]) <= half[1]) {
                add_node(load, face_node(mesh, face, i, j));
            }
        }
    }
    if (load->nnode == 0) {
        add_node(load, face_node(mesh, face, (int)lround(centre[0] / spacing[0]),
                                 (int)lround(centre[1] / spacing[1])));
    }
}

// Draws size and direction of the force. The axes `axis` [3] are perpendicular, and number `in` of
// them points into the body.
static void draw_force(pm_beam_load *load, const pm_beam_patches *patches, int in,
                       double (*axis)[3], pm_rng *rng) {
    double direction[3] = {0}, square = 0;
    for (int k = 0; k < 3; ++k) {
        const double part = k == in ? 1 : patches->tilt * pm_rng_normal(rng);
        for (int d = 0; d < 3; ++d) {
            direction[d] += part * axis[k][d];
        }
        square += part * part;
    }
    const double size = draw_between(rng, patches->force) / (load->nnode * sqrt(square));
    for (int d = 0; d < 3; ++d) {
        load->force[d] = size * direction[d];
    }
}

// Draws the times at which the force has risen, begins to fall and has fallen.
static void draw_times(pm_beam_load *load, const pm_beam_patches *patches, pm_rng *rng) {
    load->time[1] = draw_between(rng, patches->ramp);
    load->time[2] = load->time[1] + draw_between(rng, patches->hold);
    load->time[3] = load->time[2] + draw_between(rng, patches->unload);
}

void pm_beam_load_patch(pm_beam_load *load, const pm_beam_mesh *mesh,
                        const pm_beam_patches *patches, pm_rng *rng) {
    *load = (pm_beam_load){.fraction = {0, 1, 1, 0}};
    const int face = patches->face < 0 ? (int)pm_rng_below(rng, PM_BEAM_FACES) : patches->face;
    const double along[2] = {nearest * mesh->size[0], mesh->size[0]};
    const double across[2] = {0, mesh->size[axis_across(face)]};
    // Separate statements, because C does not define in which order the members of a list are
    // evaluated.
    double centre[2], half[2];
    centre[0] = draw_between(rng, along);
    centre[1] = draw_between(rng, across);
    half[0] = draw_between(rng, patches->length) / 2;
    half[1] = draw_between(rng, patches->width) / 2;
    add_rectangle(load, mesh, face, centre, half);
    double axis[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    axis[axis_in(face)][axis_in(face)] = sign_in(face);
    draw_force(load, patches, axis_in(face), axis, rng);
    draw_times(load, patches, rng);
}

// Computes two axes [3] of the tangential plane and, third, the one into the body. The first one is
// that closest to x, or to y where the plane is perpendicular to x.
static void find_axes(const double *outward, double (*axis)[3]) {
    const int along = fabs(outward[0]) < 0.9 ? 0 : 1;
    double square = 0;
    for (int d = 0; d < 3; ++d) {
        axis[2][d] = -outward[d];
        axis[0][d] = (d == along) - outward[along] * outward[d];
        square += axis[0][d] * axis[0][d];
    }
    for (int d = 0; d < 3; ++d) {
        axis[0][d] /= sqrt(square);
    }
    for (int d = 0; d < 3; ++d) {
        const int e = (d + 1) % 3, f = (d + 2) % 3;
        axis[1][d] = axis[2][e] * axis[0][f] - axis[2][f] * axis[0][e];
    }
}

// Returns true if a node lies in the rectangle around `centre`, and not on another side of the
// body.
static bool lies_in(const double *x, const double *centre, double (*axis)[3],
                    const double half[2]) {
    const double reach[3] = {half[0], half[1], fmax(half[0], half[1]) / 2};
    for (int k = 0; k < 3; ++k) {
        double along = 0;
        for (int d = 0; d < 3; ++d) {
            along += axis[k][d] * (x[d] - centre[d]);
        }
        if (fabs(along) > reach[k]) {
            return false;
        }
    }
    return true;
}

void pm_beam_load_skin(pm_beam_load *load, const pm_beam_mesh *mesh, const pm_beam_skin *skin,
                       const pm_beam_patches *patches, pm_rng *rng) {
    *load = (pm_beam_load){.fraction = {0, 1, 1, 0}};
    const pm_beam_face *face = pm_beam_skin_draw(skin, nearest, rng);
    double axis[3][3], half[2];
    find_axes(face->outward, axis);
    half[0] = draw_between(rng, patches->length) / 2;
    half[1] = draw_between(rng, patches->width) / 2;
    for (int i = 0; i < skin->nnode; ++i) {
        const int node = skin->node[i];
        if (!mesh->clamped[node] && pm_beam_skin_faces(skin, i, face->outward) &&
            lies_in(mesh->position[node], face->centre, axis, half)) {
            add_node(load, node);
        }
    }
    for (int i = 0; i < 4 && load->nnode == 0; ++i) { // a small patch between nodes
        add_node(load, face->node[i]);
    }
    draw_force(load, patches, 2, axis, rng);
    draw_times(load, patches, rng);
}

// Returns the fraction of the full load at time t s.
static double fraction_at(const pm_beam_load *load, double t) {
    for (int i = 1; i < PM_BEAM_KNOTS; ++i) {
        if (t < load->time[i]) {
            const double part = (t - load->time[i - 1]) / (load->time[i] - load->time[i - 1]);
            return load->fraction[i - 1] + part * (load->fraction[i] - load->fraction[i - 1]);
        }
    }
    return load->fraction[PM_BEAM_KNOTS - 1];
}

void pm_beam_load_at(const pm_beam_load *load, const pm_beam_mesh *mesh, double t, double *f) {
    const double fraction = fraction_at(load, t);
    const int first = load->body * (mesh->nnode / mesh->nbody);
    double force[3];
    pm_beam_placement_turn(&mesh->placement[load->body], load->force, force);
    memset(f, 0, 3 * (size_t)mesh->nnode * sizeof *f);
    for (int i = 0; i < load->nnode; ++i) {
        for (int d = 0; d < 3; ++d) {
            f[3 * (first + load->node[i]) + d] = fraction * force[d];
        }
    }
}
