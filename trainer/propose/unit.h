// Units as powers of the base units, as far as text such as "kg m^2/s", "J/(K mol)" or "V s" tells.
#ifndef PM_TRAINER_PROPOSE_UNIT_H
#define PM_TRAINER_PROPOSE_UNIT_H

#include <stdbool.h>

enum { PM_UNIT_KG, PM_UNIT_M, PM_UNIT_S, PM_UNIT_A, PM_UNIT_K, PM_UNIT_MOL, PM_UNIT_BASES };

typedef struct pm_unit {
    bool known;
    int power[PM_UNIT_BASES]; // of kg, m, s, A, K, mol; angles are numbers
} pm_unit;

// Symbols joined by blanks, '*' or '.', with powers "^2", "^-1" or "2" behind them; what follows a
// '/' divides: one symbol, or several in parentheses. "1" and "" are numbers. Not known: a symbol
// that is none of SI's without a prefix.
pm_unit pm_unit_parse(const char *text);

// Whether both are known, and the same.
bool pm_unit_equal(const pm_unit *a, const pm_unit *b);
pm_unit pm_unit_product(const pm_unit *a, const pm_unit *b);

#endif
