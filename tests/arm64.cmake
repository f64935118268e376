# A CMake toolchain that builds for arm64 on another Debian machine and runs the tests under qemu. CMAKE_SYSROOT is a
# folder with Debian's arm64 libraries; tests/arm64.sh makes it.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
set(libraries ${CMAKE_SYSROOT}/usr/lib/aarch64-linux-gnu)
# No package is configured in the folder, so that no link leads to the OpenBLAS that is there.
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64-static -L ${CMAKE_SYSROOT}
    -E LD_LIBRARY_PATH=/usr/lib/aarch64-linux-gnu/openblas-pthread)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(ENV{PKG_CONFIG_SYSROOT_DIR} ${CMAKE_SYSROOT})
set(ENV{PKG_CONFIG_LIBDIR}
    ${libraries}/pkgconfig:${CMAKE_SYSROOT}/usr/share/pkgconfig:${libraries}/openblas-pthread/pkgconfig)
