// Separate boxes of bricks, for tests of contact pairs and interfaces.
#ifndef PM_TESTS_BOXES_H
#define PM_TESTS_BOXES_H

#include "bodies/solid/contact_pairs.h"

#define GAP 0.25
#define MOST_NODES 100

typedef struct box {
    double position[MOST_NODES][3], hexahedron[MOST_NODES][8], u[MOST_NODES][3];
    pm_placed_body placed;
} box;

// Makes a box of count [3] bricks along x, y, z from the origin on, each a cube of side `step` m.
void box_make(box *b, const int count[3], double step);

// Fails the test unless a number of a pair is as expected, to rounding.
void boxes_check(const char *what, int pair, double value, double expected);

#endif
