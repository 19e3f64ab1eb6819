/* Calls of the C library on files below one folder fail where they are told to: preloaded by benchmarks/failed_calls.py.
 *
 * Every call is counted, in the order in which the threads of the process make them. Nothing else is changed.
 */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

#define MOST_FILES 4096
enum { SHORT = -1, FULL = -2 }; /* instead of an errno: half of the bytes; from here on no space */

static char folder[PATH_MAX];
static size_t folder_length;
static long strike_at[2];
static int strike_with[2];
static int log_file = -1;
static atomic_long made;
static atomic_int full;
static _Atomic char ours[MOST_FILES];

void failing_calls_arm(const char *below, long first, int first_with, long second, int second_with, int log)
{
    snprintf(folder, sizeof folder, "%s", below);
    strike_at[0] = first, strike_with[0] = first_with;
    strike_at[1] = second, strike_with[1] = second_with;
    log_file = log;
    made = 0;
    full = 0;
    folder_length = strlen(folder);
}

static int below(const char *path)
{
    return folder_length && path && !strncmp(path, folder, folder_length);
}

static int of_ours(int file)
{
    return folder_length && file >= 0 && file < MOST_FILES && ours[file];
}

/* Returns 0 if the call is to be made, SHORT if half of it, else sets errno and returns 1. */
static int struck(const char *call, const char *path, int takes_space)
{
    long number = ++made;
    int with = 0;
    char line[256];
    for (int at = 0; at < 2; at++)
        if (number == strike_at[at])
            with = strike_with[at];
    if (log_file >= 0) {
        int length = snprintf(line, sizeof line, "%ld %s %d %s\n", number, call, with, path ? path + folder_length : "");
        syscall(SYS_write, log_file, line, length < (int)sizeof line ? length : (int)sizeof line - 1);
    }
    if (with == FULL)
        full = 1;
    if (with > 0 || (full && takes_space)) {
        errno = with > 0 ? with : ENOSPC;
        return 1;
    }
    return with == SHORT ? SHORT : 0;
}

#define REAL(name) \
    static __typeof__(name) *real; \
    if (!real) \
        real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

static int opened(int file)
{
    if (file >= 0 && file < MOST_FILES)
        ours[file] = 1;
    return file;
}

#define MODE \
    mode_t mode = 0; \
    if (flags & (O_CREAT | O_TMPFILE)) { \
        va_list rest; \
        va_start(rest, flags); \
        mode = va_arg(rest, mode_t); \
        va_end(rest); \
    }
#define OPEN(name) \
    int name(const char *path, int flags, ...) \
    { \
        MODE REAL(name); \
        if (!below(path)) \
            return real(path, flags, mode); \
        return struck("open", path, flags & O_CREAT) == 1 ? -1 : opened(real(path, flags, mode)); \
    }
#define OPENAT(name) \
    int name(int at, const char *path, int flags, ...) \
    { \
        MODE REAL(name); \
        if (!below(path)) \
            return real(at, path, flags, mode); \
        return struck("open", path, flags & O_CREAT) == 1 ? -1 : opened(real(at, path, flags, mode)); \
    }
OPEN(open)
OPEN(open64)
OPENAT(openat)
OPENAT(openat64)

int close(int file)
{
    REAL(close);
    if (!of_ours(file))
        return real(file);
    ours[file] = 0;
    int failed = struck("close", 0, 0) == 1, error = errno, result = real(file);
    if (!failed)
        return result;
    errno = error;
    return -1;
}

#define BY_FILE(type, name, call, given, handed, space) \
    type name given \
    { \
        REAL(name); \
        return of_ours(file) && struck(call, 0, space) == 1 ? (type)-1 : real handed; \
    }
#define MOVING(name, call, space, given, handed) \
    ssize_t name given \
    { \
        REAL(name); \
        if (of_ours(file)) { \
            int what = struck(call, 0, space); \
            if (what == 1) \
                return -1; \
            if (what == SHORT && count > 1) \
                count /= 2; \
        } \
        return real handed; \
    }
MOVING(read, "read", 0, (int file, void *data, size_t count), (file, data, count))
MOVING(pread, "read", 0, (int file, void *data, size_t count, off_t at), (file, data, count, at))
MOVING(pread64, "read", 0, (int file, void *data, size_t count, off64_t at), (file, data, count, at))
MOVING(write, "write", 1, (int file, const void *data, size_t count), (file, data, count))
MOVING(pwrite, "write", 1, (int file, const void *data, size_t count, off_t at), (file, data, count, at))
MOVING(pwrite64, "write", 1, (int file, const void *data, size_t count, off64_t at), (file, data, count, at))
BY_FILE(ssize_t, writev, "write", (int file, const struct iovec *parts, int count), (file, parts, count), 1)
BY_FILE(off_t, lseek, "seek", (int file, off_t at, int from), (file, at, from), 0)
BY_FILE(off64_t, lseek64, "seek", (int file, off64_t at, int from), (file, at, from), 0)
BY_FILE(int, ftruncate, "truncate", (int file, off_t size), (file, size), 0)
BY_FILE(int, ftruncate64, "truncate", (int file, off64_t size), (file, size), 0)
BY_FILE(int, fsync, "sync", (int file), (file), 1)
BY_FILE(int, fdatasync, "sync", (int file), (file), 1)
BY_FILE(int, fstat, "stat", (int file, struct stat *found), (file, found), 0)
BY_FILE(int, fstat64, "stat", (int file, struct stat64 *found), (file, found), 0)
BY_FILE(void *, mmap, "map", (void *to, size_t size, int how, int flags, int file, off_t at), (to, size, how, flags, file, at), 0)
BY_FILE(void *, mmap64, "map", (void *to, size_t size, int how, int flags, int file, off64_t at), (to, size, how, flags, file, at), 0)

#define BY_PATH(type, failed, name, call, given, handed, space) \
    type name given \
    { \
        REAL(name); \
        return below(path) && struck(call, path, space) == 1 ? failed : real handed; \
    }
BY_PATH(int, -1, stat, "stat", (const char *path, struct stat *found), (path, found), 0)
BY_PATH(int, -1, stat64, "stat", (const char *path, struct stat64 *found), (path, found), 0)
BY_PATH(int, -1, lstat, "stat", (const char *path, struct stat *found), (path, found), 0)
BY_PATH(int, -1, lstat64, "stat", (const char *path, struct stat64 *found), (path, found), 0)
BY_PATH(int, -1, fstatat, "stat", (int at, const char *path, struct stat *found, int flags), (at, path, found, flags), 0)
BY_PATH(int, -1, fstatat64, "stat", (int at, const char *path, struct stat64 *found, int flags), (at, path, found, flags), 0)
BY_PATH(int, -1, mkdir, "mkdir", (const char *path, mode_t mode), (path, mode), 1)
BY_PATH(int, -1, unlink, "unlink", (const char *path), (path), 0)
BY_PATH(int, -1, rename, "rename", (const char *path, const char *to), (path, to), 1)
BY_PATH(DIR *, 0, opendir, "list", (const char *path), (path), 0)

/* Memory: of the requests for LARGE bytes and more, those from `first` on fail, `count` of them. */
#define LARGE 512
static atomic_long asked;
static long starve_first, starve_end;

void failing_calls_starve(long first, long count)
{
    asked = 0;
    starve_end = first + count;
    starve_first = first;
}

static int starved(size_t size)
{
    if (!starve_first || size < LARGE)
        return 0;
    long number = ++asked;
    if (number < starve_first || number >= starve_end)
        return 0;
    errno = ENOMEM;
    return 1;
}

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *held, size_t size);

void *malloc(size_t size)
{
    return starved(size) ? 0 : __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    return starved(count * size) ? 0 : __libc_calloc(count, size);
}

void *realloc(void *held, size_t size)
{
    return starved(size) ? 0 : __libc_realloc(held, size);
}
