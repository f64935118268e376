// Computes the positions and bricks of a box.
#include <math.h>
#include <string.h>

#include "tests/support/boxes.h"
#include "tests/support/unit.h"

static int node_of(const int count[3], int i, int j, int k) {
    return (k * (count[1] + 1) + j) * (count[0] + 1) + i;
}

void box_make(box *b, const int count[3], double step) {
    memset(b, 0, sizeof *b);
    b->placed = (pm_placed_body){.name = "box",
                                 .nnode = (count[0] + 1) * (count[1] + 1) * (count[2] + 1),
                                 .nelement = count[0] * count[1] * count[2],
                                 .position = b->position[0],
                                 .hexahedron = b->hexahedron[0],
                                 .placement = PM_PLACEMENT_IDENTITY};
    assert_true(b->placed.nnode <= MOST_NODES);
    for (int n = 0; n < b->placed.nnode; ++n) {
        b->position[n][0] = step * (n % (count[0] + 1));
        b->position[n][1] = step * (n / (count[0] + 1) % (count[1] + 1));
        b->position[n][2] = step * (n / (count[0] + 1) / (count[1] + 1));
    }
    static const int corner[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                     {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
    for (int e = 0; e < b->placed.nelement; ++e) {
        const int i = e % count[0], j = e / count[0] % count[1], k = e / count[0] / count[1];
        for (int c = 0; c < 8; ++c) {
            b->hexahedron[e][c] =
                node_of(count, i + corner[c][0], j + corner[c][1], k + corner[c][2]);
        }
    }
}

void boxes_check(const char *what, int pair, double value, double expected) {
    if (!(fabs(value - expected) <= 1e-12)) {
        fail_msg("%s, pair %d: %.17g, expected %.17g", what, pair, value, expected);
    }
}
