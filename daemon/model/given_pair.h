// Reads the texts of an operator's given pairs (pm_given_pair in spec.h): which groups and
// components they name, and which pairs are friction by a difference of two flows.
#ifndef PM_MODEL_GIVEN_PAIR_H
#define PM_MODEL_GIVEN_PAIR_H

#include "model/site.h"

// Splits a name such as "m[2]" into the name of the group and the number of the component, which is
// -1 where the name stands for the whole group ("m"). Returns false if the name has neither form;
// then group and component are undefined.
bool pm_given_split(const char *name, char group[PM_MAX_NAME], int *component);

// Returns true if some pair of the operator names the group or one of its components.
bool pm_given_names(const pm_operator_spec *spec, const char *group);
// Returns true if the group can take up heat: the operator's `heats` lists it, or, where `heats` is
// empty, it is an entropy by its unit.
bool pm_given_takes_heat(const pm_operator_spec *spec, const pm_site_group *group);
// Returns true if pair i of an irreversible operator is friction by a difference: neither of its
// groups takes up heat, and the site has a group that does.
bool pm_given_is_difference(const pm_operator_spec *spec, int i, const pm_site *site);

#endif
