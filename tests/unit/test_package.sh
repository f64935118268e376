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
for package in "$portmet" "$dev"; do
    for field in Package Version Architecture Maintainer Description Depends; do
        [ -n "$(dpkg-deb -f "$package" $field)" ] || fail "$package has no field $field"
    done
    name=$(dpkg-deb -f "$package" Package)
    dpkg-deb -c "$package" >"$folder/$name.list"
    grep -q "usr/share/doc/$name/copyright$" "$folder/$name.list" || fail "$name has no copyright"
    grep -q "usr/share/doc/$name/changelog.gz$" "$folder/$name.list" || fail "$name has no changelog"
    grep -vE ' (root/root) ' "$folder/$name.list" && fail "$name has files of others"
    grep -E '^.{5}w|^.{8}w' "$folder/$name.list" | grep -v '^l' && fail "$name has files that others can write"
done
dpkg-deb -f "$portmet" Depends | grep -q libhdf5 || fail "portmet does not depend on HDF5"
for file in bin/portmetd share/man/man1/portmetd.1.gz share/man/man5/portmet-scene.5.gz share/man/man5/portmet-training.5.gz \
    share/man/man5/portmet-dataset.5.gz share/bash-completion/completions/portmetd share/portmet/configs/double_pendulum.yaml; do
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
    "$@" -i "$portmet" "$dev" >"$folder/dpkg.log" 2>&1 || fail "dpkg -i: $(tail -n 5 "$folder/dpkg.log")"
    [ -x "$folder/clean/usr/bin/portmetd" ] && [ -e "$folder/clean/usr/include/portmet.h" ] || fail "nothing is installed"
    "$@" -P libportmet-dev portmet >"$folder/dpkg.log" 2>&1 || fail "dpkg -P: $(tail -n 5 "$folder/dpkg.log")"
    left=$(find "$folder/clean" ! -type d ! -path '*/var/lib/dpkg/*')
    [ -z "$left" ] || fail "what is left after removal: $left"
fi

# Debian's checker finds no error but the contact, which is that of whoever builds.
if command -v lintian >/dev/null; then
    errors=$(lintian --allow-root "$portmet" "$dev" 2>/dev/null | grep '^E:' | grep -vE 'root-in-contact|bogus-mail-host')
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
