// The text of a scene for tests: three bodies in a row with springs that stiffen, friction and
// conduction, of which the first two are each pushed by a hand. %s stands for the rest of `time`.
#ifndef PM_SUPPORT_ROW_OF_BODIES_H
#define PM_SUPPORT_ROW_OF_BODIES_H

// HANDS and PORTS: lines for further boundary inputs and ports, or "".
#define PM_ROW_OF_BODIES(HANDS, PORTS)                                     \
    "scene: row\n"                                                         \
    "time: {dt: 0.05, steps: 1000, %s}\n"                                  \
    "models:\n"                                                            \
    "  body:\n"                                                            \
    "    energy: \"|p|^2/2 + |q|^2/2 + |q|^4/4 + 300*s + s^2\"\n"          \
    "    entropy: {given: s}\n"                                            \
    "    reversible: {given: [[q, p, 1.0]]}\n"                             \
    "    irreversible: {given: [[\"p[0]\", \"p[1]\", 0.1]], heats: [s]}\n" \
    "  touch:\n"                                                           \
    "    law: bracket\n"                                                   \
    "    reversible: {given: [[a.p, b.q, 0.3]]}\n"                         \
    "    irreversible: {given: [[a.s, b.s, \"0.5*b.dE.s/a.dE.s\"]]}\n"     \
    "  push: {law: bracket, reversible: {given: [[b.f, a.p, 1.0]]}}\n"     \
    "subsystems:\n"                                                        \
    "  \"body[0:3]\":\n"                                                   \
    "    model: body\n"                                                    \
    "    state:\n"                                                         \
    "      q: {unit: m, size: 2}\n"                                        \
    "      p: {unit: kg m/s, size: 2}\n"                                   \
    "      s: {unit: J/K, size: 1}\n"                                      \
    "    initial: {q: [1.0, 0.1], p: [0.0, 0.2], s: 0.01}\n"               \
    "boundary_inputs:\n"                                                   \
    "  hand0: {f: {unit: m, dE: [0.5, 0.1]}}\n"                            \
    "  hand1: {f: {unit: m, dE: [0.2, -0.1]}}\n" HANDS "ports:\n"          \
    "  left:\n"                                                            \
    "    {law: bracket, between: [body0, body1], model: touch,\n"          \
    "     expose: {body0: [p, s], body1: [q, s]}}\n"                       \
    "  right:\n"                                                           \
    "    {law: bracket, between: [body1, body2], model: touch,\n"          \
    "     expose: {body1: [p, s], body2: [q, s]}}\n"                       \
    "  push0:\n"                                                           \
    "    {law: bracket, between: [body0, hand0], model: push,\n"           \
    "     expose: {body0: p, hand0: f}}\n"                                 \
    "  push1:\n"                                                           \
    "    {law: bracket, between: [body1, hand1], model: push,\n"           \
    "     expose: {body1: p, hand1: f}}\n" PORTS

#endif
