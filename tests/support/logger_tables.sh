# Sourced by tests of proposals, after setting.sh: writes tables as a logger would.

# write NAME COUNT HEADER BEGIN STEP: COUNT tables of 120 samples 0.02 s apart. BEGIN is executed first, STEP 20 times
# between two samples, with the time step h; the values are y[1], y[2], ..., and u changes each 15 samples.
write() {
    name=$1 count=$2 header=$3 begin=$4 step=$5
    for i in $(seq "$count"); do
        awk -v seed="$i" "BEGIN {
            srand(seed); h = 0.001; print \"t [s],$header\"; $begin
            for (k = 0; k < 120; k++) {
                if (k % 15 == 0) u = driven == 2 ? rand() : 2*rand() - 1
                printf \"%.3f\", 0.02*k; for (j = 1; j <= n; j++) printf \",%.12g\", y[j]; print driven ? sprintf(\",%.6g\", u) : \"\"
                for (j = 0; j < 20; j++) { $step }
            }
        }" >"$folder/${name}_$i.csv"
    done
}
