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
} pm_unit;

// Reads symbols that are joined by blanks, '*', '.' or a raised dot, or by nothing as in "Nm" and
// "mAh", each with an optional power "^2", "^-1", "**2", "2" or in raised characters. A '/' divides
// by the next symbol, or by several in parentheses. "1", "-" and "" are dimensionless. The result
// is `known` if every symbol is known: SI units with their prefixes, g, l, L, min, h, bar, deg, the
// sign for degrees, eV and cal.
pm_unit pm_unit_parse(const char *text);

// Returns true if both units are known and equal.
bool pm_unit_equal(const pm_unit *a, const pm_unit *b);
// Returns the product, which is known if both factors are.
pm_unit pm_unit_product(const pm_unit *a, const pm_unit *b);

#endif
