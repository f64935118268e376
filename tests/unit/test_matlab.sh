#!/bin/sh
# test_matlab.sh PORTMET_TRAIN WRITE_MATLAB_FILE: `portmet-train import` reads MATLAB files of versions 5 and 7.3.
. "$(dirname "$0")/../support/setting.sh"
train=$1 write=$2

# column NAME: the numbers of a column in the imported dataset, which has one trajectory.
column() {
    h5dump -a /state_layout "$folder/out.h5" | tr -d '"' | awk -v name="$1" '
        $1 == "(0):" { for (i = 2; i <= NF; i++) if ($i == name) print i - 2 }' >"$folder/place"
    h5dump -y -w 1 -d /z -s "0,0,$(cat "$folder/place")" -c 1,8,1 "$folder/out.h5" |
        awk '/^ *DATA [{]/ { inside = 1; next } inside && /}/ { exit } inside && NF { gsub(/[ ,]/, ""); printf "%s ", $0 }'
}

for version in 5 7.3; do
    "$write" "$folder/measured.mat" $version || fail "cannot write a file of version $version"
    timeout 200 "$train" import "$folder/measured.mat" -o "$folder/out.h5" >"$folder/out" 2>&1 ||
        fail "version $version: import fails"
    for name in rate gains note; do
        grep -q "leaves out $name" "$folder/out" || fail "version $version: expected $name to be left out"
    done
    [ "$(column theta)" = "0 0.25 0.5 0.75 1 1.25 1.5 1.75 " ] || fail "version $version: theta is $(column theta)"
    [ "$(column count)" = "-5 995 1995 2995 3995 4995 5995 6995 " ] || fail "version $version: count is $(column count)"
    [ "$(column w_1)" = "0.5 1.5 2.5 3.5 4.5 5.5 6.5 7.5 " ] || fail "version $version: w_1 is $(column w_1)"
    [ "$(column x_2)" = "0 3 6 9 12 15 18 21 " ] || fail "version $version: x_2 is $(column x_2)"
    h5dump -y -d /dt "$folder/out.h5" | grep -q " 0.5" || fail "version $version: expected a dt of 0.5 s"
done

# --- files without columns, and files of another kind ---
printf 'no MATLAB file' >"$folder/wrong.mat"
timeout 200 "$train" import "$folder/wrong.mat" -o "$folder/no.h5" >"$folder/out" 2>&1
[ $? -eq 4 ] || fail "a text file: expected exit code 4"
grep -q "cannot be read as a MATLAB file" "$folder/out" || fail "a text file: expected a message"

finish
