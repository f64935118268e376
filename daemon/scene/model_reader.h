// The `model:` block of a part or a port as YAML text, the same in training files, scenes and
// weights files. A part has:
//
//   constants: {m: 2.0}             # numbers that formulas name
//   form: hard                      # default; or soft; or free, which has only a rate
//   energy:                         # a formula, a network, {given: groups}, or a list of these,
//     - "|p|^2/(2*m)"               # which are summed up; or none
//     - {features: ["ln|q|", s], hidden: [16, 16], activation: tanh, skip: quadratic}
//   entropy: {given: s}
//   reversible:                     # given pairs [row, column, coefficient], a learned operator,
//     given: [[q, p, 1.0]]          # or both; or none
//     learned: {acts_on: [p, s], along: ["q/|q|^2"], features: ["ln|q|"], hidden: [8]}
//   irreversible:
//     given: [[p, s, "0.1*dE.s"]]   # coefficients are numbers or formulas
//     learned: {acts_on: [p, s], rank: 1, features: [s], hidden: [8], activation: softplus}
//   rate: {features: [q, p, s], hidden: [16]}               # only in form: free
//   derived: {gap: {of: [q], size: 4}}                      # offset + matrix * groups (spec.h)
//
// A network without features is a constant. Its defaults are: no hidden layers, activation tanh (or
// softplus, silu), skip none (or linear, quadratic, quartic), rank 1. A thermal energy
// {features: [x, p], thermal: [s], hidden: [8], exponentials: 2, temperature: 300.0} increases with
// the entropies s and is convex in them (model/thermal.h). A network of an energy with `scaled:
// true` has a unit of its own. A learned irreversible operator with `heats: [s]` gives the
// dissipated energy to these entropies (model/dissipation.h).
//
// The block of a port begins with a law, such as `law: bracket`. It names groups "a.q" and
// co-energies "a.dE.s" (model/spec.h). A learned reversible operator may couple some groups with
// others alone, which `against: [b.q]` lists. With `law: contact` the block has only
// `matrix: [[1.0, 0.0], [0.0, -1.0]]`, row by row. Formulas are explained in model/formula.h.
#ifndef PM_SCENE_MODEL_READER_H
#define PM_SCENE_MODEL_READER_H

#include "base/arena.h"
#include "model/spec.h"
#include "store/yaml.h"

// Read a block into plain data; everything that the spec points to lives in the arena. The
// constants of the mapping `constants`, which may be absent, replace constants of the same name in
// the block. Groups and features are checked later, against the layout (pm_part_declare,
// pm_port_declare). PM_ECONFIG with the place in the file, PM_ENOMEM; on failure *spec is
// untouched.
pm_status pm_part_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_part_spec *spec);
pm_status pm_port_spec_read(pm_yaml block, pm_yaml constants, pm_arena *arena, pm_port_spec *spec);

// Return the spec as YAML text in the arena, or NULL if memory runs out. Reading the text gives an
// equal spec; numbers that only a weights file holds are not part of it. The text is part of the
// digest of weights.
const char *pm_part_spec_write(const pm_part_spec *spec, pm_arena *arena);
const char *pm_port_spec_write(const pm_port_spec *spec, pm_arena *arena);

#endif
