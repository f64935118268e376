// write_matlab_file FILE 5|7.3: writes a MATLAB file as a measurement may come, by libmatio:
// vectors in both directions, several number types, fields of a struct, and variables that are no
// columns.
#include <matio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COUNT 8

static matvar_t *matrix(const char *name, enum matio_classes class, enum matio_types type,
                        size_t rows, size_t columns, const void *value) {
    size_t dims[2] = {rows, columns};
    return Mat_VarCreate(name, class, type, 2, dims, (void *)value, 0);
}

static matvar_t *make_struct(const double *theta, const mat_int32_t *count) {
    static const char *field[] = {"theta", "count"};
    size_t dims[2] = {1, 1};
    matvar_t *arm = Mat_VarCreateStruct("arm", 2, dims, field, 2);
    Mat_VarSetStructFieldByName(arm, "theta", 0,
                                matrix("theta", MAT_C_DOUBLE, MAT_T_DOUBLE, COUNT, 1, theta));
    Mat_VarSetStructFieldByName(arm, "count", 0,
                                matrix("count", MAT_C_INT32, MAT_T_INT32, COUNT, 1, count));
    return arm;
}

int main(int argc, char **argv) {
    double t[COUNT], theta[COUNT], gains[3] = {1, 2, 3}, rate = 10;
    mat_int32_t count[COUNT];
    float w[2 * COUNT], lying[2 * COUNT];
    for (int k = 0; k < COUNT; ++k) {
        t[k] = 0.5 * k;
        theta[k] = 0.25 * k;
        count[k] = 1000 * k - 5;
        w[k] = (float)k + 0.5f;
        w[COUNT + k] = (float)-k;
        lying[2 * k] = (float)(2 * k);
        lying[2 * k + 1] = (float)(3 * k);
    }
    if (argc != 3) {
        return 2;
    }
    mat_t *file =
        Mat_CreateVer(argv[1], NULL, strcmp(argv[2], "5") == 0 ? MAT_FT_MAT5 : MAT_FT_MAT73);
    matvar_t *const variable[] = {
        matrix("rate", MAT_C_DOUBLE, MAT_T_DOUBLE, 1, 1, &rate),
        matrix("gains", MAT_C_DOUBLE, MAT_T_DOUBLE, 1, 3, gains),
        matrix("note", MAT_C_CHAR, MAT_T_UINT8, 1, 6, "logger"),
        make_struct(theta, count),
        matrix("t", MAT_C_DOUBLE, MAT_T_DOUBLE, 1, COUNT, t),
        matrix("w", MAT_C_SINGLE, MAT_T_SINGLE, COUNT, 2, w),
        matrix("x", MAT_C_SINGLE, MAT_T_SINGLE, 2, COUNT, lying),
    };
    int failed = file == NULL;
    for (size_t i = 0; i < sizeof variable / sizeof *variable && !failed; ++i) {
        failed = Mat_VarWrite(file, variable[i], MAT_COMPRESSION_NONE) != 0;
        Mat_VarFree(variable[i]);
    }
    Mat_Close(file);
    return failed;
}
