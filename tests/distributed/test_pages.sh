#!/bin/sh
# test_pages.sh BUILD: the commands of the pages, as they stand there, work one after the other on data of their own.
. "$(dirname "$0")/../support/private_network.sh"
. "$(dirname "$0")/../support/setting.sh"
source=$(realpath "$(dirname "$0")/../..")
mkdir "$folder/here"
ln -s "$1" "$folder/here/build"
ln -s "$source/configs" "$folder/here/configs"
cd "$folder/here" || exit 1
export PATH="$PWD/build/daemon/app:$PWD/build/trainer:$PATH"

# block PAGE HEADING MARK: the first block of code below the heading: indented lines, or with MARK all lines between ```.
block() {
    awk -v heading="$2" -v mark="$3" '
        $0 == heading { on = 1; next }
        on && /^##/ && !code { exit }
        on && mark != "" && /^```/ { code = !code; next }
        on && mark != "" { if (code) print; next }
        on && /^    / { print substr($0, 5); seen = 1; next }
        on && seen { exit }' "$source/$1"
}

# follow PAGE HEADING TEXT: the commands below a heading succeed, one after the other, and TEXT is in what they print.
follow() {
    block "$1" "$2" "" >"$folder/commands"
    [ "$(wc -l <"$folder/commands")" -gt 3 ] || fail "$1: no commands below $2"
    timeout 300 sh -e "$folder/commands" >"$folder/out" 2>"$folder/err" || fail "$1: the commands below $2"
    grep -q "$3" "$folder/out" || fail "$1: expected \"$3\" from the commands below $2"
}

# tables HEADER STEP: six tables run_K.csv and a table test_1.csv of a system with an input u that is held for 10 samples;
# STEP (awk) takes its states x and y from one sample to the next.
tables() {
    rm -f run_*.csv test_*.csv
    for name in run_1 run_2 run_3 run_4 run_5 run_6 test_1; do
        awk -v name=$name -v header="$1" "BEGIN {
            for (k = 1; k <= length(name); ++k) seed += k*index(\"_123456enrstu\", substr(name, k, 1))
            srand(seed); x = rand(); y = rand(); print header
            for (k = 0; k < 120; k++) {
                if (k % 10 == 0) u = int(24*rand())
                printf \"%.3f,%.12g,%.12g,%g\n\", 0.01*k, x, y, u
                for (j = 0; j < 100; j++) { $2 }
            }
        }" >$name.csv
    done
}

tables "t [s],q [m],v [m/s],F [N]" "y += 1e-4*(u - 8*y - 30*x)/2; x += 1e-4*y"
follow README.md "## From a logger's files to processes" "steps in violation: 0"

tables "t [s],i [A],w [rad/s],u [V]" "x += 1e-4*(u - 1.2*x - 0.08*y)/0.04; y += 1e-4*(0.08*x - 1e-4*y)/8e-4"
follow trainer/README.md "## From a logger's files" "steps in violation: 0"

# A service, and Python that uses it.
if /usr/bin/python3 -c "import numpy, h5py" 2>/dev/null; then
    heading="### Serve a scene and use it from Python"
    block daemon/SERVING.md "$heading" "" | grep -v "^portmetd query" >"$folder/commands"
    block daemon/SERVING.md "$heading" mark >"$folder/script.py"
    {
        sed 's/ &$/ \& service=$!/' "$folder/commands"
        echo 'until portmetd query configs/double_pendulum.yaml | grep -q idle; do sleep 0.2; done'
        echo "timeout 100 /usr/bin/python3 '$folder/script.py'; code=\$?; kill \$service; wait; exit \$code"
    } >"$folder/all"
    timeout 200 sh "$folder/all" >"$folder/out" 2>"$folder/err" || fail "daemon/SERVING.md: $heading"
    [ "$(wc -l <"$folder/out")" -ge 3 ] || fail "daemon/SERVING.md: the script prints nothing"
fi
finish
