// Wider SIMD by run-time dispatch. The compiler makes one version of a function marked
// PM_SIMD_CLONES for each of several instruction sets, and the loader picks the widest that the
// processor has. Results are bitwise reproducible only between processors of the same kind.
#ifndef PM_BASE_SIMD_H
#define PM_BASE_SIMD_H

// With sanitizers the loader would run instrumented code before the sanitizer is initialised.
// Programs with sanitizers therefore get plain code.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(PM_SANITIZED)
#define PM_SIMD_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define PM_SIMD_CLONES
#endif

// Before a loop whose rounds do not depend on each other, whatever its pointers are. Clang finds
// that out when the program runs.
#if defined(__GNUC__) && !defined(__clang__)
#define PM_SIMD_LOOP _Pragma("GCC ivdep")
#else
#define PM_SIMD_LOOP
#endif

#endif
