// Writes the reversible operator of a subsystem in a proposed training file: conjugate pairs, what
// turns with an angular momentum, and couplings that are to be learned.
#include "propose/propose_draft.h"

static bool is_free(const pm_part_view *v, int g) {
    return v->kind[g] == PM_VIEW_OTHER && !v->group[g].constant;
}

// Whether a momentum may also move variables besides its position, such as the charge of a second
// capacitor in a loop or the stretch of a spring in series with a dashpot.
static bool moves_more(const pm_part_view *v, int momentum) {
    const pm_unit action = pm_unit_parse("J s");
    for (int g = 0; g < v->count && v->kind[momentum] == PM_VIEW_MOMENTUM; ++g) {
        const pm_unit product = pm_unit_product(&v->unit[g], &v->unit[momentum]);
        if (is_free(v, g) && v->group[g].group->size == v->group[momentum].group->size &&
            pm_unit_equal(&product, &action)) {
            return true;
        }
    }
    return false;
}

// Whether the lossless coupling of this group with others, or among its components, is learned.
static bool is_coupled(const pm_part_view *v, int g) {
    return is_free(v, g) || v->gyroscopic[g] || v->gyrates[g] || moves_more(v, g);
}

// Writes the coupling of an angular momentum with a quaternion.
static void write_quaternion(const pm_draft *d, const char *before, const pm_part_view *v, int g) {
    const double half = 0.5 / v->unit[v->mate[g]].factor;
    const char *name = pm_draft_name(v, g), *m = pm_draft_name(v, v->mate[g]);
    for (int k = 0; k < 12; ++k) {
        int column;
        const int sign = pm_quaternion_term(v->quaternion[g], k / 3, k % 3, &column);
        fprintf(d->file, "%s[\"%s[%d]\", \"%s[%d]\", \"%.17g*%s[%d]\"]", k == 0 ? before : ", ",
                name, k / 3, m, k % 3, sign * half, name, column);
    }
}

// Writes L = sign z x for an angular momentum, and with a direction for this direction. In other
// units than kg m^2/s the cross product has a factor.
static void write_cross(const pm_draft *d, const char *before, const pm_part_view *v, int g) {
    const int spin = v->kind[g] == PM_VIEW_SPIN ? g : v->mate[g];
    const double factor = v->unit[spin].factor * v->sign[g];
    const char *m = pm_draft_name(v, spin), *name = pm_draft_name(v, g);
    if (!(factor < 1 || factor > 1)) {
        fprintf(d->file, "%s[%s, %s, cross]", before, m, name);
        return;
    }
    for (int c = 0, n = 0; c < 3; ++c) {
        for (int k = 1; k <= (g == spin ? 1 : 2); ++k) {
            fprintf(d->file, "%s[\"%s[%d]\", \"%s[%d]\", \"%.17g*%s[%d]\"]",
                    n++ == 0 ? before : ", ", m, c, name, (c + k) % 3, (k == 1 ? -1 : 1) / factor,
                    name, (c + 3 - k) % 3);
        }
    }
}

void pm_draft_reversible(const pm_draft *d, const pm_part_view *v) {
    FILE *f = d->file;
    int given = 0, others = 0;
    bool odd = false;
    for (int g = 0; g < v->count; ++g) {
        const char *name = pm_draft_name(v, g), *before = given > 0 ? ", " : "given: [";
        const bool turns = v->kind[g] == PM_VIEW_SPIN || v->kind[g] == PM_VIEW_DIRECTION;
        if (given == 0 && (v->kind[g] == PM_VIEW_POSITION || turns)) {
            fprintf(f, "    reversible:\n      ");
        }
        if (v->kind[g] == PM_VIEW_POSITION) {
            fprintf(f, "%s[%s, %s, ", before, name, pm_draft_name(v, v->mate[g]));
            pm_draft_coefficient(f, v->sign[g], &v->unit[g], &v->unit[v->mate[g]]);
            fputc(']', f);
            ++given;
        } else if (turns) {
            const bool quaternion = v->quaternion[g].turns != 0;
            (quaternion ? write_quaternion : write_cross)(d, before, v, g);
            ++given;
        }
        others += is_coupled(v, g) ? v->group[g].group->size : 0;
        odd = odd || (is_coupled(v, g) && v->odd[g]);
    }
    fprintf(f, given > 0 ? "]\n" : "");
    if (others < 2 || !odd) { // such as the amounts of two species
        return;
    }
    pm_draft_list l = pm_draft_open(f, given > 0 ? "      learned: {acts_on: "
                                                 : "    reversible:\n      learned: {acts_on: ");
    for (int g = 0; g < v->count; ++g) {
        if (is_coupled(v, g)) {
            pm_draft_add(&l, "", pm_draft_name(v, g));
        }
    }
    fprintf(f, "]}\n");
}
