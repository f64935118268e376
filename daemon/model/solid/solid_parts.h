// The parts of a body of learned material. Only the files that implement solid.h include this
// header:
//     solid.c           opens a body, sets and moves its state
//     solid_element.c   evaluates all elements: forces, energies, stresses
//     solid_lanes.c     evaluates the forces alone, faster
//     solid_stiffness.c numbers the free components and factorises the stiffness
//     solid_step.c      finds the balance of forces
#ifndef PM_MODEL_SOLID_SOLID_PARTS_H
#define PM_MODEL_SOLID_SOLID_PARTS_H

#include "model/solid/solid.h"

// The pairs of displacements and forces of which the balance keeps at most so many (solid_step.c).
#define PM_SOLID_PAIRS 12

// The shapes without volume at the points of an element, with the energies of the spring and of the
// branches there.
typedef struct pm_solid_start {
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
    double *stiffness;              // [nfree][width + 1] by columns, or its factor
    double *u, *inner;              // the state
    pm_solid_start *start;          // [nelement] at the state
    double *volume_energy;          // [nelement] J, at the state
    double stiff_for;               // s, step of the factor in `stiffness`; NAN: none
    double *stiff_u, *stiff_inner;  // the state to which this factor belongs
    double *trial, *after;          // the same as u and inner, of the step under way
    double *force;                  // [nnode][3] N, of the elements at `trial`
    double *residual, *move, *last; // [nfree]
    int npair;                      // pairs known of the factor in `stiffness`
    double *pair_u, *pair_f;        // [PM_SOLID_PAIRS][nfree]
    pm_solid_books books;
};

// The sums over all elements at a displacement.
typedef struct pm_solid_sums {
    double work, heat; // J
} pm_solid_sums;

// Evaluates all elements at the displacements s->trial, h s after the state: the inner variables
// s->after and the forces s->force. If `sums` is not NULL, it also makes sure that no branch gains
// energy, and computes the sums. Returns false if an element is turned inside out.
bool pm_solid_evaluate(pm_solid *s, double h, pm_solid_sums *sums);
// Computes the same forces, up to rounding, and nothing else.
bool pm_solid_forces(pm_solid *s, double h);
// Computes s->start and returns the stored energy of the state, J, which is not turned inside out.
double pm_solid_begin(pm_solid *s);
// Copies the displacements of an element's nodes to x [PM_BRICK_NODES][3].
void pm_solid_gather(const pm_solid *s, int element, const double *u, double *x);
// Computes dpsi/dCbar of all branches and the spring at a point, without the volume, and adds the
// modulus there.
void pm_solid_point_stress(const pm_solid *s, const pm_solid_shape *shape, const double *inner,
                           double *T, double *modulus);
// Computes the second Piola-Kirchhoff stress S from T and the pressure, Pa.
void pm_solid_piola(const pm_solid_shape *shape, const double *T, double pressure, double *S);

// Numbers the free components so that the band is narrow, and makes the memory of the stiffness.
// PM_ECONFIG: no node is free. PM_ENOMEM.
pm_status pm_solid_number(pm_solid *s);

#endif
