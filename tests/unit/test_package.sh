#!/bin/sh
# test_package.sh BUILD: cpack makes Debian packages that hold what they should, run from where they are
# unpacked, and leave nothing behind when they are removed. The completion of the shell knows the commands.
. "$(dirname "$0")/../support/setting.sh"
build=$1
source=$(realpath "$(dirname "$0")/../..")
for tool in dpkg-deb dpkg-shlibdeps cpack man bash; do
    command -v $tool >/dev/null || { echo "skipped: no $tool"; exit 77; }
done

(cd "$build" && cpack -G DEB -B "$folder/made") >"$folder/cpack.log" 2>&1 || fail "cpack: $(tail -n 5 "$folder/cpack.log")"
portmet=$(ls "$folder"/made/portmet_*.deb)
dev=$(ls "$folder"/made/libportmet-dev_*.deb)
library=$(ls "$folder"/made/libportmet0_*.deb)
python=$(ls "$folder"/made/python3-portmet_*.deb)
for package in "$folder"/made/*.deb; do
    for field in Package Version Architecture Maintainer Description Depends; do
        [ -n "$(dpkg-deb -f "$package" $field)" ] || fail "$package has no field $field"
    done
    name=$(dpkg-deb -f "$package" Package)
    dpkg-deb -f "$package" Description | grep -q '^[^:]*: ' && dpkg-deb -f "$package" Description | sed -n 2p | grep -q '^ [^ ]' ||
        fail "the description of $name: $(dpkg-deb -f "$package" Description)"
    dpkg-deb -c "$package" >"$folder/$name.list"
    grep -q "usr/share/doc/$name/copyright$" "$folder/$name.list" || fail "$name has no copyright"
    grep -q "usr/share/doc/$name/changelog.gz$" "$folder/$name.list" || fail "$name has no changelog"
    grep -vE ' (root/root) ' "$folder/$name.list" && fail "$name has files of others"
    grep -E '^.{5}w|^.{8}w' "$folder/$name.list" | grep -v '^l' && fail "$name has files that others can write"
done
dpkg-deb -f "$portmet" Depends | grep -q libhdf5 || fail "portmet does not depend on HDF5"
for package in "$portmet" "$library" "$dev" "$python"; do
    dpkg-deb -f "$package" Depends | grep -qi -E 'mpi|gmsh' && fail "$package needs $(dpkg-deb -f "$package" Depends)"
done
dpkg-deb -I "$python" prerm | grep -q 'py3clean -p python3-portmet' || fail "compiled files of Python stay behind"
dpkg-deb -f "$python" Depends | grep -q 'libportmet0 (= ' || fail "python3-portmet does not depend on its library"
for file in dist-packages/portmet/scene.py dist-packages/portmet/py.typed dist-packages/portmet-[0-9.]*.dist-info/METADATA; do
    grep -q "usr/lib/python3/$file$" "$folder/python3-portmet.list" || fail "python3-portmet lacks $file"
done
grep -q 'lib/.*libportmet[.]so[.]0 -> ' "$folder/libportmet0.list" || fail "libportmet0 lacks the library"
grep -q 'libportmet' "$folder/portmet.list" && fail "portmet has the library"
cat "$folder"/*.list | grep '[.]pc$' | grep -v libportmet.pc && fail "another file for pkg-config"
for file in bin/portmetd share/man/man1/portmetd.1.gz share/man/man5/portmet-scene.5.gz share/man/man5/portmet-training.5.gz \
    share/man/man5/portmet-dataset.5.gz share/doc/portmet/README.md \
    share/doc/portmet/daemon/SCENE.md share/doc/portmet/trainer/TRAINING.md share/portmet/python/tables/__main__.py share/bash-completion/completions/portmetd share/portmet/configs/double_pendulum.yaml; do
    grep -q "usr/$file$" "$folder/portmet.list" || fail "portmet lacks $file"
done
grep -q 'include/portmet.h' "$folder/libportmet-dev.list" || fail "libportmet-dev lacks the header"
grep -q 'include/' "$folder/portmet.list" && fail "portmet has headers"

# Unpacked anywhere, the programs run.
dpkg-deb -x "$portmet" "$folder/root"
"$folder/root/usr/bin/portmetd" run "$folder/root/usr/share/portmet/configs/double_pendulum.yaml" --in-process \
    --steps 3 --quiet || fail "the packaged program does not run"
for page in "$folder"/root/usr/share/man/man[15]/*.gz; do
    warnings=$(man --warnings -l "$page" 2>&1 >/dev/null)
    [ -z "$warnings" ] || fail "$page: $warnings"
done
man -l "$folder/root/usr/share/man/man5/portmet-scene.5.gz" 2>/dev/null | col -b | grep -q "^ *integrator" ||
    fail "the page of scenes lacks a key"

# Installed into a root of their own and removed again.
if [ "$(id -u)" -eq 0 ]; then
    mkdir -p "$folder/clean/var/lib/dpkg/updates" "$folder/clean/var/lib/dpkg/info"
    : >"$folder/clean/var/lib/dpkg/status"
    : >"$folder/clean/var/lib/dpkg/available"
    set -- dpkg --root="$folder/clean" --force-depends --force-script-chrootless --log=/dev/null
    "$@" -i "$portmet" "$library" "$dev" "$python" >"$folder/dpkg.log" 2>&1 || fail "dpkg -i: $(tail -n 5 "$folder/dpkg.log")"
    [ -x "$folder/clean/usr/bin/portmetd" ] && [ -e "$folder/clean/usr/include/portmet.h" ] || fail "nothing is installed"
    if /usr/bin/python3 -c 'import numpy, h5py' 2>/dev/null; then
        PYTHONPATH=$folder/clean/usr/lib/python3/dist-packages /usr/bin/python3 -B -c "import importlib.metadata, portmet
assert portmet.Scene('$folder/clean/usr/share/portmet/configs/double_pendulum.yaml').step(2).steps == 2
assert '$folder' in portmet.__file__ and importlib.metadata.version('portmet') == portmet.__version__" ||
            fail "the installed package for Python"
    fi
    "$@" -P python3-portmet libportmet-dev libportmet0 portmet >"$folder/dpkg.log" 2>&1 || fail "dpkg -P: $(tail -n 5 "$folder/dpkg.log")"
    left=$(find "$folder/clean" ! -type d ! -path '*/var/lib/dpkg/*')
    [ -z "$left" ] || fail "what is left after removal: $left"
fi

# Debian's checker finds nothing but the contact, which is that of whoever builds.
if command -v lintian >/dev/null; then
    # Only builds for /usr know the folder of this kind of machine.
    errors=$(lintian --allow-root "$folder"/made/*.deb 2>/dev/null | grep '^[EW]:' |
        grep -vE 'root-in-contact|bogus-mail-host|pkg-config-unavailable|portmet-mpi: maintscript-calls-ldconfig')
    [ -z "$errors" ] || fail "lintian: $errors"
fi

# complete WORDS...: what the completion offers for the last word.
complete() {
    bash -c '. "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _portmet; printf "%s " "${COMPREPLY[@]}"' \
        bash "$source/daemon/package/completion.bash" "$folder/root/usr/bin/portmetd" "$@"
}
case " $(complete ch) " in *" check "*) ;; *) fail "completion of ch: $(complete ch)" ;; esac
case " $(complete run --in) " in *" --in-process "*) ;; *) fail "completion of --in: $(complete run --in)" ;; esac
case " $(complete emit sys) $(complete emit procman x --ho) " in *" systemd "*" --hosts "*) ;; *) fail "completion of emit" ;; esac
case " $(complete export --o) " in *" --output "*) ;; *) fail "completion of --o: $(complete export --o)" ;; esac

finish
