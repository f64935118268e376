// Fields of bodies as data for a learned material (model/solid/material.h): the mesh, the
// displacements, and how large each quantity is in a trajectory.
#ifndef PM_BODIES_SOLID_SOLID_DATA_H
#define PM_BODIES_SOLID_SOLID_DATA_H

#include "bodies/field/field.h"
#include "model/solid/solid.h"

typedef struct pm_solid_data {
    const pm_field *field; // borrowed
    pm_solid_mesh mesh;
    int position, stress;   // first variables of the field that are positions and stresses
    int count, *trajectory; // [count] the trajectories of the field that count
} pm_solid_data;

// The quantities in which a learned body is compared with its data.
enum {
    PM_SOLID_DISPLACEMENT,
    PM_SOLID_STRESS,
    PM_SOLID_STORED,
    PM_SOLID_DISSIPATED,
    PM_SOLID_NSCORE
};

// Makes the mesh of a field; a node that never moves is clamped. All trajectories count, until the
// caller shortens the list. Memory comes from the arena; the field is borrowed. PM_EDATA: the field
// has no elements, positions, stresses or energies. PM_ENOMEM.
pm_status pm_solid_data_open(pm_solid_data *data, const pm_field *field, pm_arena *arena);

// Computes the displacements u [nnode][3], m, of trajectory i at time j.
void pm_solid_data_displacement(const pm_solid_data *data, int i, int j, double *u);

// Returns the number `which` of PM_FIELD_ENERGIES energies of trajectory i at time j, J; 0 if the
// field has none.
double pm_solid_data_energy(const pm_solid_data *data, int i, int j, int which);

// Computes the sums of the squares of each quantity over trajectory i: displacement and stress over
// the free nodes. `u` [nnode][3] is work space.
void pm_solid_data_size(const pm_solid_data *data, int i, double *u, double size[PM_SOLID_NSCORE]);

#endif
