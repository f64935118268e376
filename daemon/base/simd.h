// Wider SIMD by run-time dispatch: a function so marked is compiled for several instruction sets
// and the loader picks the widest the processor has. Results are equal on one kind of processor
// only.
#ifndef PM_BASE_SIMD_H
#define PM_BASE_SIMD_H

// Sanitizers instrument the resolver before they are initialised, so they get the plain code.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(PM_SANITIZED)
#define PM_SIMD_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define PM_SIMD_CLONES
#endif

#endif
