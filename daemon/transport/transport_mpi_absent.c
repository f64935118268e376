// The MPI transport of a program that was built without MPI: every call says so.
#include "transport/transport_table.h"

static pm_status fail(void) {
    return pm_fail(PM_ECONFIG, "this program was built without MPI (libopenmpi-dev), which mpi:// "
                               "needs");
}

static pm_status mpi_check(const char *url) {
    (void)url;
    return fail();
}

static pm_status mpi_open(void **state, const char *url, pm_drops *drops) {
    (void)state, (void)url, (void)drops;
    return fail();
}

static pm_status mpi_place(int *rank, int *count) {
    (void)rank, (void)count;
    return fail();
}

const pm_transport_table pm_transport_mpi = {
    .check = mpi_check,
    .open = mpi_open,
    .place = mpi_place,
};
