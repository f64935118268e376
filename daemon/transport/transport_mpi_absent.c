// The MPI transport of a library whose program belongs to no job of MPI.
#include "transport/transport_table.h"

pm_status pm_transport_mpi_load(const pm_transport_table **table) {
    (void)table;
    return pm_fail(PM_ECONFIG,
                   "mpi:// connects the processes that mpirun has started, and no others");
}
