// How AddressSanitizer keeps house under libFuzzer: little memory, used again soon, is several
// times faster than the 256 MiB of freed blocks that it holds back by default, which always have to
// be fetched from the system anew. What was freed within the last few executions is still held.
const char *__asan_default_options(void);

const char *__asan_default_options(void) {
    return "quarantine_size_mb=1:allocator_release_to_os_interval_ms=-1:"
           "clear_shadow_mmap_threshold=10000000:malloc_context_size=8";
}
