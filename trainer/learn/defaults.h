// What a training file leaves open: how energies, operators and their starts are parametrised so
// that a first guess learns well. `defaults: plain` in the training file leaves models as they are
// written.
#ifndef PM_TRAINER_LEARN_DEFAULTS_H
#define PM_TRAINER_LEARN_DEFAULTS_H

#include "base/arena.h"
#include "model/part.h"
#include "model/port.h"
#include "scene/system.h"

// Of a part with a given entropy s: an energy's network of s becomes thermal (model/thermal.h) and
// starts at the temperature that a linear form of s in the energy gave, which goes; a learned
// irreversible operator heats s (model/dissipation.h). All energies carry units. PM_ENOMEM.
pm_status pm_default_part(pm_part_spec *spec, const pm_layout *layout, pm_arena *arena);

// Of a port whose ends' parts have their specs: a learned irreversible operator heats the entropies
// that both ends expose. PM_ENOMEM.
pm_status pm_default_port(pm_port_spec *spec, const pm_system *system, int port, pm_arena *arena);

#endif
