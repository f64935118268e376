// XDMF beside a field file (field.h), so that ParaView and its like open it: for each trajectory a
// collection over time of the deformed hexahedra, with displacement u, velocity v, stress as a
// symmetric tensor, its von Mises stress and the forces, as far as the field has them. All numbers
// stay in the field file, from which the XDMF selects them (https://www.xdmf.org, version 2;
// written for ParaView's "XDMF Reader"). Positions are those of the body's own frame.
#ifndef PM_STORE_XDMF_H
#define PM_STORE_XDMF_H

#include "store/field.h"

// Describes the file at `path`, as pm_field_save wrote it from this field, in a file of the same
// name that ends in .xdmf, which refers to it by name alone: both may be moved together. PM_EFILE,
// PM_EDATA (no hexahedra), PM_ENOMEM.
pm_status pm_xdmf_save(const pm_field *field, const char *path);

#endif
