// A picture of bodies on a mesh: their surfaces, deformed, coloured by von Mises stress.
#ifndef PM_TRAINER_BODY_PICTURE_H
#define PM_TRAINER_BODY_PICTURE_H

#include "store/field.h"

// Bodies that say where they lie in the world are drawn in one scene, others one above another.
typedef struct pm_picture {
    int count;
    const pm_field *const *field; // [count], with hexahedra, of variables sxx syy szz sxy sxz syz;
                                  // undeformed without qx qy qz
    const char *const *title;     // [count]
    int trajectory;
    double time; // s; of each field the state nearest to it
} pm_picture;

// Draws with gnuplot into `path`, a PNG; the script stays beside it, with the ending .gp.
// PM_EUSAGE (`path` has that ending itself), PM_EFILE, PM_EDATA (no mesh, stress or trajectory),
// PM_ENOMEM.
pm_status pm_picture_draw(const pm_picture *picture, const char *path);

#endif
