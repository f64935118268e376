// Any bytes must read as tables, or be refused with one line and an exit code. The reader is a
// program in Python, which answers here for one file after another (read_tables.py). The first byte
// of the input chooses the ending of the file's name.
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/status.h"
#include "bytes_file.h"
#include "tests/fuzz/target.h"

#define LINE 4096 // bytes of an answer

typedef struct reader {
    pid_t pid; // 0: it does not run
    FILE *to, *from;
} reader;

static void start(reader *r) {
    int to[2], from[2];
    check(pipe(to) == 0 && pipe(from) == 0);
    r->pid = fork();
    check(r->pid >= 0);
    if (r->pid == 0) {
        dup2(to[0], STDIN_FILENO);
        dup2(from[1], STDOUT_FILENO);
        close(to[1]);
        close(from[0]);
        execlp("python3", "python3", "-B", PM_FUZZ_READER, (char *)NULL);
        _exit(127);
    }
    close(to[0]);
    close(from[1]);
    r->to = fdopen(to[1], "w");
    r->from = fdopen(from[0], "r");
    check(r->to != NULL && r->from != NULL);
}

// Ends the reader, and returns true if a signal has ended it before.
static bool stop(reader *r) {
    int status = 0;
    fclose(r->to);
    fclose(r->from);
    check(waitpid(r->pid, &status, 0) == r->pid);
    r->pid = 0;
    return WIFSIGNALED(status);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char *const ending[] = {".csv", ".mat", ".tsv", ".parquet", ".txt"};
    static const char signature[] = "\x89HDF\r\n\x1a\n";
    static reader r;
    char path[sizeof PM_FUZZ_FILE + 16], answer[LINE];
    if (size == 0) {
        return 0;
    }
    if (r.pid == 0) {
        signal(SIGPIPE, SIG_IGN);
        start(&r);
    }
    bytes_file(data + 1, size - 1);
    snprintf(path, sizeof path, "%s%s", PM_FUZZ_FILE,
             ending[data[0] % (sizeof ending / sizeof *ending)]);
    unlink(path);
    check(link(PM_FUZZ_FILE, path) == 0);
    fprintf(r.to, "%s\n", path);
    fflush(r.to);
    int code = -1, lines = -1;
    if (fgets(answer, sizeof answer, r.from) == NULL) {
        // Only the HDF5 library crashes; `portmet-train` notices the end of its reader.
        check(stop(&r) && memmem(data + 1, size - 1, signature, sizeof signature - 1) != NULL);
    } else {
        check(sscanf(answer, "%d %d", &code, &lines) == 2);
        check(lines == (code != 0));
        check(code == PM_OK || code == PM_EFILE || code == PM_EDATA || code == PM_ENOMEM);
    }
    unlink(path);
    return 0;
}
