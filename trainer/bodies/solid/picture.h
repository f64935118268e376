// Draws the deformed surfaces of bodies on a mesh, coloured by the von Mises stress.
#ifndef PM_BODIES_SOLID_PICTURE_H
#define PM_BODIES_SOLID_PICTURE_H

#include "bodies/field/field.h"

// Bodies whose fields carry a placement are drawn in one scene, others in panels one below another.
typedef struct pm_picture {
    int count;
    // The last `nbeside` bodies are drawn in a scene of their own, in a panel below that of the
    // others. 0: there is one scene.
    int nbeside;
    // [count], with hexahedra and the variables sxx syy szz sxy sxz syz (Pa). A field without the
    // positions qx qy qz (m) is drawn undeformed.
    const pm_field *const *field;
    const char *const *title; // [count]
    const int *trajectory;    // [count] of each field, counted from 0
    double time;              // s; the state of each field nearest to it is drawn
    // A further panel shows the von Mises stress of the bodies of the second panel less the stress
    // of those of the first.
    bool error;
} pm_picture;

// Draws the picture with gnuplot into the PNG file `path`. The script remains beside it, with the
// ending .gp. PM_EUSAGE (`path` itself has that ending, or `error` without two panels whose bodies
// have equal numbers of nodes), PM_EFILE, PM_EDATA (no mesh, no stress or no such trajectory),
// PM_ENOMEM.
pm_status pm_picture_draw(const pm_picture *picture, const char *path);

#endif
