// The parts of a body of learned material. Only the files that implement solid.h include this
// header:
//     solid.c           a body: its state, its stiffness, and the balance of forces
//     solid_element.c   its elements: forces, energies, stresses
#ifndef PM_MODEL_SOLID_SOLID_PARTS_H
#define PM_MODEL_SOLID_SOLID_PARTS_H

#include <string.h>

#include "model/solid/solid.h"

// The balance of forces keeps at most this many pairs of displacements and forces.
#define PM_SOLID_PAIRS 12

// How many past displacements the prediction of the next ones uses.
#define PM_SOLID_PAST 3

// An iteration ends when a move is shorter than this share of the largest displacement.
#define PM_SOLID_PRECISE 3e-6

// The shapes without volume at the points of an element, with the energies of the spring and of the
// branches there, and of the volume.
typedef struct pm_solid_start {
    double volume; // J
    double Cbar[PM_SYM][PM_BRICK_POINTS], inverse[PM_SYM][PM_BRICK_POINTS];
    double spring[PM_BRICK_POINTS]; // J/m^3
    double branch[PM_SOLID_MAX_BRANCHES][PM_BRICK_POINTS];
} pm_solid_start;

struct pm_solid {
    pm_arena arena;
    const pm_solid_mesh *mesh;
    const pm_solid_material *material;
    pm_brick *brick;                // [nelement]
    int ninner, nfree;              // numbers
    int *free;                      // [nfree] component of each free number
    int *number;                    // [nnode] first free number of a node, or -1
    int width;                      // of the band below the diagonal of the stiffness
    double *stiffness;              // [nfree][width + 1] by columns
    float *factor;                  // [nfree][width + 1] of the stiffness
    double *u, *inner;              // the state
    pm_solid_start *start;          // [nelement] at the state
    pm_solid_start *next;           // [nelement] of the state under way
    const double *guess;            // [nnode][3] where an iteration starts; NULL: where steps lead
    double precise;                 // share of the largest displacement at which it ends
    double stiff_for;               // s, step of the factor; NAN: none
    double *stiff_u, *stiff_inner;  // the state to which this factor belongs
    double *trial, *after;          // the same as u and inner, of the step under way
    double *force;                  // [nnode][3] N, of the elements at `trial`
    double *residual, *move, *last; // [nfree]
    int npast;                      // displacements known
    double past_for;                // s, the step between them
    double *past; // [PM_SOLID_PAST][nnode][3] m, at the starts of the last steps, last first
    int npair;    // pairs known of the factor
    double *pair_u, *pair_f; // [PM_SOLID_PAIRS][nfree]
    pm_solid_books books;
};

// Computes the forces s->force of the elements at the displacements s->trial, h s after the state.
// Returns false if an element is turned inside out.
bool pm_solid_forces(pm_solid *s, double h);
// Computes the inner variables s->after at the displacements s->trial, h s after the state, with
// s->next and the energies of the books, of which `work` and `heat` are those of this step. No
// branch gains energy. Returns false if an element is turned inside out, or an energy is not
// finite.
bool pm_solid_finish(pm_solid *s, double h, pm_solid_books *sum);
// Computes s->next and the stored energy, J, of the state u, inner. Returns false if an element is
// turned inside out.
bool pm_solid_begin(pm_solid *s, const double *u, const double *inner, double *stored);
// Copies the displacements of an element's nodes to x [PM_BRICK_NODES][3].
static inline void pm_solid_gather(const pm_solid *s, int element, const double *u, double *x) {
    const int *node = s->mesh->brick + (ptrdiff_t)element * PM_BRICK_NODES;
    for (int n = 0; n < PM_BRICK_NODES; ++n) {
        memcpy(x + 3 * n, u + 3 * (ptrdiff_t)node[n], 3 * sizeof *x);
    }
}

#endif
