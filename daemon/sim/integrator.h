// The table of integrators lies in the scene's layer, since reading a scene looks one up.
#ifndef PM_SIM_INTEGRATOR_H
#define PM_SIM_INTEGRATOR_H

#include "scene/integrator.h" // IWYU pragma: export

#endif
