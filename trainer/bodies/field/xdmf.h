// Describes a field file (field.h) in XDMF, version 2 (https://www.xdmf.org), so that ParaView's
// "XDMF Reader" and similar tools can open it. The description holds, for each trajectory, the
// deformed hexahedra over time with displacement u, velocity v, the symmetric stress tensor, the
// von Mises stress and the forces, as far as the field has them. The numbers stay in the field
// file, from which the XDMF selects them. Positions are in the body's own frame.
#ifndef PM_BODIES_XDMF_H
#define PM_BODIES_XDMF_H

#include "bodies/field/field.h"

// Describes the file that pm_field_save wrote from this field to `path`. The description has the
// same name with the ending .xdmf and refers to the file by name alone, so that both can be moved
// together. PM_EFILE; PM_EDATA: the field has no hexahedra; PM_ENOMEM.
pm_status pm_xdmf_save(const pm_field *field, const char *path);

#endif
