// A body in few numbers: what turns the fields of one (store/field.h) into the state of a
// subsystem, and back.
//
// State. Displacements are u = sum_i a_i mode_i + the rest. The first `nstate` modes carry the
// energy: a_i follow the loads. The rest (sections that turn make a linear mode swell; what a load
// does just under it) is a function of the state and the loads. Modes are scaled such that 1/2
// a_i^2 is the energy of mode i alone in the undeformed body, deformed at once; so a is in J^0.5,
// and the load of mode i, mode_i . f, too. What the material remembers are, for each relaxation
// time tau_k,
//     dc_k/dt = (a - c_k) / tau_k,
// the Prony series carried over from points to modes. The quasi-static body is given inertia: all
// modes inertia_time with the same short period, 2 pi `inertia_time`; p = inertia_time^2 da/dt.
//
// Sources: proper orthogonal decomposition (Sirovich, Quart. Appl. Math. 45, 1987), a quadratic and
// cubic manifold for the rest (Barnett, Farhat, J. Comput. Phys. 464, 2022).
#ifndef PM_TRAINER_MODAL_BASIS_H
#define PM_TRAINER_MODAL_BASIS_H

#include "base/arena.h"
#include "base/status.h"
#include "modal/local.h"

#define PM_BASIS_MAX_MODES 64
#define PM_BASIS_MAX_BRANCHES 4
#define PM_BASIS_MAX_RANK 1000
#define PM_BASIS_TENSOR 6

// A nodal field as a function of the features: features . coefficient . pattern.
typedef struct pm_pattern {
    int rank, width;     // numbers of the field: components times nodes
    double *coefficient; // [nfeature][rank]
    double *pattern;     // [rank][width]
} pm_pattern;

typedef struct pm_basis {
    pm_arena arena; // owns all that follows
    int nnode;
    int nmode;  // modes in all; those outside the state by what loads do on them
    int nstate; // the first of them are the state
    int nlead;  // the first of these appear in products of two and three
    int nbranch;
    double tau[PM_BASIS_MAX_BRANCHES]; // s
    double inertia_time;               // s
    double temperature;                // K, at which what is dissipated becomes entropy
    double *position;                  // [nnode][3] m, undeformed
    int nelement;                      // 0: not known
    double *hexahedron;                // [nelement][8] nodes
    double *mode;                      // [nmode][nnode][3] m/J^0.5, orthogonal
    double *stiffness;       // [nmode] J^0.5 per m of the mode's norm, squared: 1 / mode_i . mode_i
    double *lead_scale;      // [nlead] J^0.5, that makes the products of order 1
    pm_pattern displacement; // m, [nnode][3]: the rest beside the modes of the state
    pm_local local;          // what loads do to the stress around them, beside its pattern
    pm_pattern stress;       // Pa, [nnode][6]; rank 0: not known
} pm_basis;

// What is known of the body at one time.
typedef struct pm_modal_state {
    const double *a;    // [nstate]
    const double *c;    // [nbranch][nstate]
    const double *load; // [nmode]
} pm_modal_state;

// Features: a, c and loads; products of two and three of the leading a, and of the leading c of
// each branch.
int pm_basis_features(const pm_basis *basis);
void pm_basis_fill_features(const pm_basis *basis, const pm_modal_state *reading, double *feature);

// Adds the field of a pattern to value [width]; `feature` [pm_basis_features].
void pm_pattern_add(const pm_pattern *pattern, int nfeature, const double *feature, double *value);

// Makes one with room for all but the patterns. PM_ENOMEM. The caller frees.
pm_status pm_basis_new(pm_basis **basis, int nnode, int nmode, int nstate, int nlead);
// Room for a mesh. PM_ENOMEM.
pm_status pm_basis_add_mesh(pm_basis *basis, int nelement);
// Room for a pattern. PM_ENOMEM.
pm_status pm_basis_add_pattern(pm_basis *basis, pm_pattern *pattern, int rank, int width);
void pm_basis_free(pm_basis *basis); // NULL is allowed

// Which coordinates a state in this basis is in, "basis " and a digest of all that gives its
// numbers their meaning: modes, relaxation times, inertia_time, temperature. Patterns do not count.
#define PM_BASIS_COORDINATES 32
void pm_basis_coordinates(const pm_basis *basis, char text[PM_BASIS_COORDINATES]);
// Whether what was made in these coordinates (`text` NULL: nobody knows) is of this basis; `what`
// names it in the error. PM_EDATA.
pm_status pm_basis_check(const pm_basis *basis, const char *text, const char *what);

// PM_EFILE, PM_EDATA, PM_ENOMEM.
pm_status pm_basis_load(pm_basis **basis, const char *path);
// With the command that made it.
pm_status pm_basis_save(const pm_basis *basis, const char *path, const char *command);

#endif
