// Parts on a small mesh, as the text of a `model:` block, for a state of two fields u and m of
// three components per node and an entropy s.
#ifndef PM_TESTS_MESH_PART_H
#define PM_TESTS_MESH_PART_H

#include <stdlib.h>

#define MESH_NODES 27 // of 3 x 2 x 2 bricks
#define MESH_TEXT "mesh: {size: [3, 2, 1], elements: [3, 2, 2]}\n"

// The first part is like a beam: the heat variable s takes the dissipated energy. In the second
// part every potential and operator depends on all fields.
static const char *const mesh_part[2] = {
    MESH_TEXT "energy:\n"
              "  - {given: {s: 300.0}}\n"
              "  - \"|u|^2/2 - 0.3*<u,m> + 0.4*|m|^2/2\"\n"
              "  - {nodes: [u], width: 4, passes: 2, patterns: 3, hidden: [5]}\n"
              "entropy: {given: s}\n"
              "reversible: {learned: {acts_on: [u, m], nodes: [u], width: 3, passes: 1}}\n"
              "irreversible:\n"
              "  given: [[u, s, 60.0], [m, s, 7.0]]\n"
              "  learned: {acts_on: [u, m], rank: 2, nodes: [u], width: 3, passes: 1}\n",
    MESH_TEXT
    "energy:\n"
    "  - {given: {s: 300.0}}\n"
    "  - {nodes: [u, m], width: 4, passes: 2, patterns: 3}\n"
    "entropy: [{given: s}, {nodes: [m, u], width: 4, passes: 0, patterns: 2, hidden: [3]}]\n"
    "reversible: {learned: {acts_on: [u, m], nodes: [m, u], width: 3, passes: 0}}\n"
    "irreversible: {learned: {acts_on: [m, u], rank: 3, nodes: [u], width: 3, passes: 2}}\n",
};

// Returns the number of edges between two nodes, from their indices along x, y, z.
static inline int mesh_distance(int a, int b) {
    const int n[3] = {3, 3, 3};
    int sum = 0;
    for (int c = 0; c < 3; a /= n[c], b /= n[c], ++c) {
        sum += abs(a % n[c] - b % n[c]);
    }
    return sum;
}

#endif
