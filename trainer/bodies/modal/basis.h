// A basis turns the nodal fields of one body (bodies/field/field.h) into the state of a subsystem
// and back.
//
// Displacements are u = sum_i a_i mode_i + remainder, with the amplitudes a_i. The first `nstate`
// modes carry the energy. The state consists of their amplitudes a, their momenta p and their
// internal variables c_k, both defined below. The remainder is a function of a, c_k, the loads and
// the delayed loads, which are defined below.
// It contains, for example, the change of length that linear modes show when a section rotates, and
// the indentation under a load.
//
// Each mode is scaled such that a_i^2/2 is the elastic energy of the body that is deformed by this
// mode alone, by a small amount, before the material relaxes. An amplitude therefore has the unit
// J^0.5, and so has the modal load mode_i . f of nodal forces f. The relaxation of the viscoelastic
// material is a Prony series with the times tau_k. The basis applies this series to each mode
// instead of each point of the body. The internal variables of the modes obey
//     dc_k/dt = (a - c_k) / tau_k.
// The remainder creeps, too. After a load is removed, the modes outside of the state come back as
// slowly as those of the state, so that their loads of the moment do not determine them. They
// depend on delayed loads l_k, too, which follow from the history of the loads by
//     dl_k/dt = (load - l_k) / retardation_k.
// The retardation times are those with which a body of this material creeps under a constant load.
// The quasi-static body is given inertia such that all modes oscillate with the same short period
// 2 pi inertia_time. The momentum of a mode is p = inertia_time^2 da/dt.
//
// Sources: modes by proper orthogonal decomposition (Sirovich, Quart. Appl. Math. 45, 1987); the
// remainder as a quadratic and cubic manifold (Barnett, Farhat, J. Comput. Phys. 464, 2022).
#ifndef PM_BODIES_MODAL_BASIS_H
#define PM_BODIES_MODAL_BASIS_H

#include "base/arena.h"
#include "base/status.h"
#include "bodies/modal/local.h"

#define PM_BASIS_MAX_MODES 64
#define PM_BASIS_MAX_BRANCHES 4
#define PM_BASIS_MAX_RANK 1000
#define PM_BASIS_TENSOR 6

// A nodal field as a function of the features of a state, of low rank:
//     field = features . coefficient . pattern
typedef struct pm_pattern {
    int rank;
    int width;           // numbers of the field: components times nodes
    double *coefficient; // [nfeature][rank]
    double *pattern;     // [rank][width]
} pm_pattern;

typedef struct pm_basis {
    pm_arena arena; // owns the arrays
    int nnode;
    int nmode;  // all modes; those from nstate on are ordered by the work that loads do on them
    int nstate; // modes whose amplitudes are in the state: the first ones
    int nlead;  // modes whose products of two and three amplitudes are features: the first ones
    int nbranch;
    double tau[PM_BASIS_MAX_BRANCHES];         // s, relaxation times
    int nretardation;                          // 0 or nbranch
    double retardation[PM_BASIS_MAX_BRANCHES]; // s, retardation times
    double inertia_time;                       // s
    double temperature;                        // K, at which dissipated energy becomes entropy
    double *position;                          // [nnode][3] m, undeformed
    int nelement;                              // 0: the mesh is not known
    double *hexahedron;                        // [nelement][8] nodes, numbered as in VTK
    double *mode;                              // [nmode][nnode][3] m/J^0.5, orthogonal
    double *stiffness;                         // [nmode] J/m^2, 1 / (mode_i . mode_i)
    double *lead_scale;      // [nlead] J^0.5, largest amplitude, which scales products
    pm_pattern displacement; // m, [nnode][3], the remainder
    pm_local local;          // stress close to the loads, which is added to `stress`
    pm_pattern stress;       // Pa, [nnode][6]; rank 0: not known
} pm_basis;

// The state of a body at one time. The caller owns the arrays.
typedef struct pm_modal_state {
    const double *a;       // [nstate] J^0.5
    const double *c;       // [nbranch][nstate] J^0.5
    const double *load;    // [nmode] J^0.5
    const double *delayed; // [nretardation][nmode] J^0.5
} pm_modal_state;

// Advances count numbers y, which obey dy/dt = (x - y)/tau, over a time dt, s, in which x changes
// linearly from `before` to `now`. The solution is exact.
void pm_basis_relax(int count, double tau, double dt, const double *before, const double *now,
                    double *y);

// Returns the number of features. The features are a, c and the loads, the products of two and
// three of the leading amplitudes and of the leading internal variables of each branch, and the
// delayed loads.
int pm_basis_features(const pm_basis *basis);
// Fills feature [pm_basis_features].
void pm_basis_fill_features(const pm_basis *basis, const pm_modal_state *state, double *feature);

// Adds the field of a pattern at feature [nfeature] to value [width].
void pm_pattern_add(const pm_pattern *pattern, int nfeature, const double *feature, double *value);

// Makes a basis with room for everything but mesh and patterns. PM_ENOMEM. The caller frees it.
pm_status pm_basis_new(pm_basis **basis, int nnode, int nmode, int nstate, int nlead);
// Adds room for a mesh. PM_ENOMEM.
pm_status pm_basis_add_mesh(pm_basis *basis, int nelement);
// Adds room for one of the patterns of the basis. PM_ENOMEM.
pm_status pm_basis_add_pattern(pm_basis *basis, pm_pattern *pattern, int rank, int width);
void pm_basis_free(pm_basis *basis); // NULL is allowed

// Writes the name of the basis's coordinates: "basis " and a digest of everything that gives the
// numbers of a state their meaning, which is modes, relaxation times, inertia_time and temperature.
// Datasets and weights carry this name.
#define PM_BASIS_COORDINATES 32
void pm_basis_coordinates(const pm_basis *basis, char text[PM_BASIS_COORDINATES]);
// Checks that a dataset or weights file with the coordinates `text` belongs to this basis; NULL or
// "" (the file does not say) passes. `what` names the file in the error. PM_EDATA.
pm_status pm_basis_check(const pm_basis *basis, const char *text, const char *what);

// Loads a basis from HDF5; the caller frees it. PM_EFILE, PM_EDATA, PM_ENOMEM.
pm_status pm_basis_load(pm_basis **basis, const char *path);
// Saves a basis together with the command that made it. PM_EFILE, PM_ENOMEM.
pm_status pm_basis_save(const pm_basis *basis, const char *path, const char *command);

#endif
