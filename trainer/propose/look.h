// A look at data before anything is learned of them: how large states and rates are, how fast they
// change, which variables move with which others, and what is conserved.
#ifndef PM_TRAINER_PROPOSE_LOOK_H
#define PM_TRAINER_PROPOSE_LOOK_H

#include "scene/columns.h"

// A group of a part.
typedef struct pm_look_group {
    const pm_group *group;
    int first;        // of its first component in the concatenated state
    double deviation; // pooled over its components
    double rate;      // root mean square, 1/s of its unit, likewise
    bool constant;    // it does not move
    bool positive;    // all components are, in all states
    bool zero;        // some state comes close to zero in all components, in units of the deviation
} pm_look_group;

typedef struct pm_look {
    pm_arena arena;
    const pm_scene *scene;
    const pm_dataset *dataset;
    pm_columns columns;
    int count;        // states looked at
    double *z, *rate; // [count][nz], rates by central differences or the data's own
    double fastest;   // 1/s: the largest rate of change of a rate, over the rate
    int samples;      // states in all trajectories
} pm_look;

// PM_EDATA: trajectories too short; as pm_columns_bind. The caller frees.
pm_status pm_look_make(pm_look *look, const pm_scene *scene, const pm_dataset *dataset);
void pm_look_free(pm_look *look);

pm_look_group pm_look_at(const pm_look *look, int subsystem, int group);

// Explains the rate of a group by other groups of its size, component by component, with one
// coefficient for each and one constant for each component: coefficient [count]. Returns the part
// of the rate's variance that stays unexplained, 0 to 1; 1 if there is nothing to explain. At most
// PM_LOOK_SOURCES groups count.
#define PM_LOOK_SOURCES 16
double pm_look_explain(const pm_look *look, const pm_look_group *target, int count,
                       const pm_look_group *source, double *coefficient);
// The same by powers 1 to `degree` of each; count * degree at most PM_LOOK_SOURCES.
double pm_look_explain_powers(const pm_look *look, const pm_look_group *target, int count,
                              const pm_look_group *source, int degree);

// Whether the sum over the pairs of q x p, in the columns' own coordinates, stays what it is along
// each trajectory: then nothing depends on directions.
bool pm_look_keeps_rotation(const pm_look *look, int count, const pm_look_group *q,
                            const pm_look_group *p);

#endif
