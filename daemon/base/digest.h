// A 64-bit FNV-1a digest (Fowler, Noll and Vo). It tells whether two processes hold the
// same scene and weights. It detects mistakes, not attacks. Numbers are folded in as little-endian
// bytes, so that all hosts agree.
#ifndef PM_BASE_DIGEST_H
#define PM_BASE_DIGEST_H

#include <stddef.h>
#include <stdint.h>

// The initial value of a digest (the FNV offset basis).
#define PM_DIGEST_INIT UINT64_C(0xcbf29ce484222325)

// Each returns `digest` with its argument folded in. Text is folded in with its terminating zero,
// so that "ab" and "c" differ from "a" and "bc".
uint64_t pm_digest_text(uint64_t digest, const char *text);
uint64_t pm_digest_integer(uint64_t digest, int64_t value);
uint64_t pm_digest_doubles(uint64_t digest, const double *value, size_t count);

#endif
