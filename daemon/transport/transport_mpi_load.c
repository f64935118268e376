// The MPI transport is a module, so that programs need no MPI for other URLs.
#include "base/plugin.h"
#include "transport/transport_table.h"

pm_status pm_transport_mpi_load(const pm_transport_table **table) {
    const void *found = NULL;
    PM_TRY(pm_plugin_find("portmet-mpi.so", "pm_transport_mpi", &found));
    *table = found;
    return PM_OK;
}
