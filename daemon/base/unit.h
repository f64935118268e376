// Units as powers of the base units with a factor, read from texts such as "kg m^2/s", "J/(K mol)",
// "V s" or "kJ/K".
#ifndef PM_BASE_UNIT_H
#define PM_BASE_UNIT_H

#include <stdbool.h>

enum { PM_UNIT_KG, PM_UNIT_M, PM_UNIT_S, PM_UNIT_A, PM_UNIT_K, PM_UNIT_MOL, PM_UNIT_BASES };

typedef struct pm_unit {
    bool known;
    int power[PM_UNIT_BASES]; // of kg, m, s, A, K, mol; angles are dimensionless
    double factor;            // how many of these base units one of this unit is: 1e-3 for "mm"
    double offset;            // of zero in base units: 273.15 for "degC"; 0 for most
    bool angle;               // it counts angles, as rad, deg or rpm
    bool cycles;              // it counts cycles, as Hz
} pm_unit;

// Reads symbols that are joined by blanks, '*', '.' or a raised dot, or by nothing as in "Nm" and
// "mAh", each with an optional power "^2", "^-1", "**2", "2" or in raised characters. A '/' divides
// by the next symbol, or by several in parentheses, which may contain others. "1", "-" and "" are
// dimensionless. The result is `known` if every symbol is known: SI units with their prefixes, and
// those of the table in unit.c, such as l, min, bar, deg and eV. Alone, degC, degF and % are known,
// too.
pm_unit pm_unit_parse(const char *text);

// Returns true if both units are known and equal.
bool pm_unit_equal(const pm_unit *a, const pm_unit *b);
// Return the product and the quotient, which are known if both operands are.
pm_unit pm_unit_product(const pm_unit *a, const pm_unit *b);
pm_unit pm_unit_quotient(const pm_unit *a, const pm_unit *b);

// Finds how a number x in the unit `text` becomes factor x + offset in the unit `to`. "C" and "F"
// are temperatures where `to` is one. Returns false if the units are unknown or of different
// quantities, or if one counts cycles and the other angles: whether 1 Hz is 1 rad/s or 2 pi rad/s
// nobody states.
bool pm_unit_conversion(const char *text, const pm_unit *to, double *factor, double *offset);
// Returns the symbol of the unit that `unit` equals, or NULL. There is none for numbers and 1/s.
const char *pm_unit_symbol(const pm_unit *unit);

// Writes the name of the unit to `text` [PM_UNIT_NAME]: its symbol, or the product of base units,
// such as "kg m/s" or "1/s". Returns false, and writes nothing, if the unit is unknown, or is a
// multiple of base units that has no symbol.
enum { PM_UNIT_NAME = 64 };
bool pm_unit_name(const pm_unit *unit, char *text);

#endif
