// Names, lists and numbers in a proposed training file.
#include <math.h>

#include "propose/propose_draft.h"

const char *pm_draft_name(const pm_part_view *v, int g) {
    return v->group[g].group->name;
}

pm_draft_list pm_draft_open(FILE *file, const char *before) {
    fprintf(file, "%s[", before);
    return (pm_draft_list){.file = file};
}

void pm_draft_add(pm_draft_list *l, const char *before, const char *name) {
    fprintf(l->file, "%s%s%s", l->count++ > 0 ? ", " : "", before, name);
}

void pm_draft_number(FILE *file, double number) {
    const double nearest = round(number);
    const bool whole = fabs(number - nearest) <= 1e-14 * fabs(number); // but for rounding
    fprintf(file, whole && fabs(nearest) <= 1e9 ? "%.1f" : "%.17g", whole ? nearest : number);
}

void pm_draft_coefficient(FILE *file, double coefficient, const pm_unit *a, const pm_unit *b) {
    pm_draft_number(file, coefficient * pm_view_coefficient_unit(a, b));
}
