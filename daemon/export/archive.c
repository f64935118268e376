// Local headers, members, and the central directory.
#include "export/archive.h"

#include <stdint.h>
#include <string.h>

#define VERSION 20  // of the format: folders
#define DATE 0x0021 // 1 January 1980, so that the same scene gives the same bytes
#define LARGEST INT32_MAX

struct pm_archive_member {
    const char *name;
    uint32_t crc, size, offset;
    pm_archive_member *older;
};

static uint32_t crc_of(const unsigned char *bytes, size_t size) {
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < size; ++i) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; ++bit) {
            crc = crc >> 1 ^ ((crc & 1) != 0 ? UINT32_C(0xedb88320) : 0);
        }
    }
    return ~crc;
}

static void put16(FILE *file, unsigned value) {
    fputc((int)(value & 0xff), file);
    fputc((int)(value >> 8 & 0xff), file);
}

static void put32(FILE *file, uint32_t value) {
    put16(file, value & 0xffff);
    put16(file, value >> 16);
}

// Writes what the local header and the directory's entry of a member have in common.
static void put_common(FILE *file, const pm_archive_member *m) {
    put16(file, VERSION);
    put16(file, 0); // flags
    put16(file, 0); // stored
    put16(file, 0); // time
    put16(file, DATE);
    put32(file, m->crc);
    put32(file, m->size);
    put32(file, m->size);
    put16(file, (unsigned)strlen(m->name));
    put16(file, 0); // extra field
}

pm_status pm_archive_add(pm_archive *archive, const char *name, const void *bytes, size_t size) {
    const long offset = ftell(archive->file);
    pm_archive_member *m = pm_arena_alloc(archive->arena, sizeof *m);
    const char *kept = pm_arena_strdup(archive->arena, name);
    if (m == NULL || kept == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for an archive");
    }
    if (offset < 0 || offset > LARGEST || size > LARGEST) {
        return pm_fail(PM_EFILE, "%s: %zu bytes are too large for an archive", name, size);
    }
    *m = (pm_archive_member){kept, crc_of(bytes, size), (uint32_t)size, (uint32_t)offset,
                             archive->newest};
    archive->newest = m;
    ++archive->count;
    put32(archive->file, 0x04034b50);
    put_common(archive->file, m);
    fputs(name, archive->file);
    fwrite(bytes, 1, size, archive->file);
    return PM_OK;
}

void pm_archive_finish(pm_archive *archive) {
    FILE *file = archive->file;
    const long begin = ftell(file);
    for (const pm_archive_member *m = archive->newest; m != NULL; m = m->older) {
        put32(file, 0x02014b50);
        put16(file, VERSION);
        put_common(file, m);
        put16(file, 0); // comment
        put16(file, 0); // disk
        put16(file, 0); // internal attributes
        put32(file, 0); // external attributes
        put32(file, m->offset);
        fputs(m->name, file);
    }
    const long end = ftell(file);
    put32(file, 0x06054b50);
    put16(file, 0);
    put16(file, 0);
    put16(file, (unsigned)archive->count);
    put16(file, (unsigned)archive->count);
    put32(file, (uint32_t)(end - begin));
    put32(file, (uint32_t)begin);
    put16(file, 0); // comment
}
