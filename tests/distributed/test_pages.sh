#!/bin/sh
# test_pages.sh BUILD: the commands of the pages, as they stand there, work one after the other on data of their own.
. "$(dirname "$0")/../support/private_network.sh"
. "$(dirname "$0")/../support/setting.sh"
source=$(realpath "$(dirname "$0")/../..")
mkdir "$folder/here" "$folder/here/build" "$folder/bin"
for part in daemon trainer; do
    ln -s "$1/$part" "$folder/here/build/$part"
done
ln -s "$source/configs" "$folder/here/configs"
ln -s /usr/bin/python3 "$folder/bin/python3" # Debian's, which the pages mean
cd "$folder/here" || exit 1
export PATH="$PWD/build/daemon/app:$PWD/build/trainer:$folder/bin:$PATH"

# run PAGE TEXT: the commands in $folder/commands succeed, and TEXT is in what they print; "": they print nothing.
run() {
    [ "$(wc -l <"$folder/commands")" -ge 1 ] || fail "$1: no commands"
    timeout 200 unshare -mpf --mount-proc --kill-child sh -e "$folder/commands" >"$folder/out" 2>"$folder/err" || fail "$1: its commands"
    case $2 in
    "") [ ! -s "$folder/out" ] || fail "$1: expected no output" ;;
    *) grep -q "$2" "$folder/out" || fail "$1: expected \"$2\"" ;;
    esac
}

# indented PAGE HEADING TEXT: runs the first indented block below a heading.
indented() {
    awk -v heading="$2" '
        $0 == heading { on = 1; next }
        on && /^##/ { exit }
        on && /^    / { print substr($0, 5); seen = 1; next }
        on && seen { exit }' "$source/$1" >"$folder/commands"
    run "$1" "$3"
}

# marked PAGE TEXT: runs all blocks of a page that are marked as commands.
marked() {
    awk '/^```sh$/ { on = 1; next } /^```$/ { on = 0 } on' "$source/$1" >"$folder/commands"
    run "$1" "$2"
}

# howto NAME TEXT: the same for a how-to.
howto() {
    marked "daemon/howto/$1.md" "$2"
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

howto unmeasured "bands"
marked trainer/MEASUREMENTS.md "inside 90 % bands"
howto three-subsystems "All 1[0-9] runs gave the same bits and kept both laws"
howto slow-process "^lower .*[0-9] %"
howto port-law "steps in violation: 0"
unshare -m ip netns list >"$folder/out" 2>&1 && howto two-hosts "steps in violation: 0"
tables "t [s],i [A],w [rad/s],u [V]" "x += 1e-4*(u - 1.2*x - 0.08*y)/0.04; y += 1e-4*(0.08*x - 1e-4*y)/8e-4"
howto sensors "i \[A\]: a co-energy"
tables "t [s],q [m],v [m/s],F [N]" "y += 1e-4*(u - 8*y - 30*x)/2; x += 1e-4*y"
howto own-csv "steps in violation: 0"
indented README.md "## From a logger's files to processes" "steps in violation: 0"
command -v h5diff >/dev/null && indented daemon/HOSTS.md "## Death and return" ""
if /usr/bin/python3 -c "import numpy, h5py" 2>/dev/null; then
    cp "$source/daemon/examples/circuit.py" .
    command -v h5dump >/dev/null && marked trainer/CIRCUIT.md "power       first_cooling"
    howto inputs "drives v"
    howto live-python "1.5 \["
    mkdir -p daemon && ln -s "$source/daemon/examples" daemon/examples
    command -v gnuplot >/dev/null && indented configs/README.md "## Learning and assembling from Python" "never seen together"
    howto control "reached the target"
    howto follow-a-plant "step 100: momentum off by 0.00"
    command -v unzip >/dev/null && howto fmu "modelDescription.xml"
fi

# Every row of configs/make.sh names files that are there, and options that portmet-train has.
mkdir -p "$folder/dry/build/trainer" && ln -s "$source/configs" "$folder/dry/configs" && cd "$folder/dry" || exit 1
cat >build/trainer/portmet-train <<END
#!/bin/sh
for word; do
    case \$word in
    configs/*) [ -e "\$word" ] ;;
    --*) "$1/trainer/portmet-train" "\$1" --help | grep -qw -e "\$word" ;;
    esac || { echo "\$*: \$word" >&2; exit 1; }
done
END
cp build/trainer/portmet-train build/trainer/portmet-mesh && sed -i 's/portmet-train" "$1"/portmet-mesh"/' build/trainer/portmet-mesh
chmod +x build/trainer/*
names=$(sh configs/make.sh 2>&1 | sed '1d; s/ | / /g; s/chain_\*/chain_3/')
[ "$(echo $names | wc -w)" -gt 20 ] || fail "configs/make.sh: found the names $names"
for name in $names; do
    sh configs/make.sh "$name" "$source/README.md" >"$folder/out" 2>"$folder/err" || fail "configs/make.sh $name"
done
finish
