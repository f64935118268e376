// The scene whose recordings and messages the fuzz targets read: a body in live wind.
#ifndef PM_TESTS_SMALL_SCENE_H
#define PM_TESTS_SMALL_SCENE_H

#define SMALL_SCENE                                                                     \
    "scene: small\n"                                                                    \
    "time: {dt: 0.5, steps: 4, integrator: rk4}\n"                                      \
    "models:\n"                                                                         \
    "  body: {energy: \"p^2/2 + 300*s\", entropy: {given: s}}\n"                        \
    "  drag: {law: bracket, irreversible: {given: [[a.p, b.p, 0.1]], heats: [a.s]}}\n"  \
    "subsystems:\n"                                                                     \
    "  body:\n"                                                                         \
    "    model: body\n"                                                                 \
    "    state: {p: {unit: kg m/s, size: 1}, s: {unit: J/K, size: 1}}\n"                \
    "    initial: {p: 1.0, s: 0.0}\n"                                                   \
    "live_inputs: {WIND: {values: [v]}}\n"                                              \
    "boundary_inputs: {air: {p: {unit: kg m/s, dE: [v], dS: [0]}}}\n"                   \
    "ports:\n"                                                                          \
    "  drag: {law: bracket, model: drag, between: [body, air], expose: {body: [p, s], " \
    "air: p}}\n"

#endif
