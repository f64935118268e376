// Options of AddressSanitizer for fuzzing. By default it keeps 256 MiB of freed memory in
// quarantine, so that new memory always comes from the system. A small quarantine is several times
// faster, and still covers the last few executions.
const char *__asan_default_options(void);

const char *__asan_default_options(void) {
    return "quarantine_size_mb=1:allocator_release_to_os_interval_ms=-1:"
           "clear_shadow_mmap_threshold=10000000:malloc_context_size=8";
}
