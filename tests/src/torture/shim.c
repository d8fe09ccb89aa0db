// Lets file operations of a program fail at chosen moments, ends the program there, or falsifies its clocks. Preloaded
// (LD_PRELOAD) on Linux, see shim.rs. Only operations on regular files and folders below CD_SHIM_FOLDER count, from 1.
//
//   CD_SHIM_FOLDER   absolute path of the folder
//   CD_SHIM_KINDS    letters of the operations that count: o open to write, w write, s sync, r rename, u unlink or rmdir,
//                    t truncate, m mkdir; default all
//   CD_SHIM_ACTION   kill: SIGKILL, in a write after half of its bytes; fail: the operation fails with CD_SHIM_ERROR, a write
//                    after half of its bytes if CD_SHIM_HALF is set; short: a write has only half of its bytes, without error
//   CD_SHIM_ERROR    number of the error (errno)
//   CD_SHIM_FIRST, CD_SHIM_LAST   operations to which the action applies
//   CD_SHIM_SHARE, CD_SHIM_SEED   in place of these two, share of the operations, per million, drawn at random
//   CD_SHIM_COUNT    file for the number of operations, written at the end of the program
//   CD_SHIM_CLOCK    seconds by which all clocks are wrong; with a sign "~" before them they jump at each reading, by up to so
//                    much forwards and backwards
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

enum action { NONE, KILL, FAIL, SHORT };

static struct {
    const char *folder, *kinds, *count_file;
    enum action action;
    int error, half;
    long first, last, share;
    unsigned long seed;
    long clock_offset;
    int clock_jumps;
} plan;
static long count;

static long number(const char *name, long missing) {
    const char *text = getenv(name);
    return text ? atol(text) : missing;
}

static void write_count(void) {
    char text[32];
    int length = snprintf(text, sizeof text, "%ld", count);
    int file = REAL(open64)(plan.count_file, O_WRONLY | O_CREAT | O_TRUNC, 0644);
    if (file < 0 || REAL(write)(file, text, length) != length) abort();
}

__attribute__((constructor)) static void read_plan(void) {
    const char *action = getenv("CD_SHIM_ACTION"), *clock = getenv("CD_SHIM_CLOCK");
    plan.folder = getenv("CD_SHIM_FOLDER");
    plan.kinds = getenv("CD_SHIM_KINDS");
    plan.count_file = getenv("CD_SHIM_COUNT");
    if (action) plan.action = *action == 'k' ? KILL : *action == 'f' ? FAIL : SHORT;
    plan.error = number("CD_SHIM_ERROR", EIO);
    plan.half = getenv("CD_SHIM_HALF") != NULL;
    plan.first = number("CD_SHIM_FIRST", 0);
    plan.last = number("CD_SHIM_LAST", plan.first);
    plan.share = number("CD_SHIM_SHARE", 0);
    plan.seed = number("CD_SHIM_SEED", 1);
    plan.clock_jumps = clock && *clock == '~';
    plan.clock_offset = clock ? atol(clock + plan.clock_jumps) : 0;
    if (plan.count_file) atexit(write_count);
    unsetenv("LD_PRELOAD");
}

// splitmix64 of a counter: in a program with threads the order of draws does not matter.
static unsigned long draw(unsigned long n) {
    unsigned long z = (plan.seed << 32) + n * 0x9e3779b97f4a7c15;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
}

// Counts an operation; returns what is to be done with it. A kill in place of a write is up to the caller.
static enum action next_action(char kind) {
    if (plan.kinds && !strchr(plan.kinds, kind)) return NONE;
    long n = __sync_add_and_fetch(&count, 1);
    int chosen = plan.share ? (long)(draw(n) % 1000000) < plan.share : n >= plan.first && n <= plan.last;
    if (!plan.action || !chosen) return NONE;
    if (plan.action == KILL && kind != 'w') raise(SIGKILL);
    return plan.action;
}

static int is_below(const char *path) {
    return plan.folder && !strncmp(path, plan.folder, strlen(plan.folder));
}

static int is_own_file(int file) {
    char link[64], path[PATH_MAX];
    struct stat status;
    if (file <= 2 || !plan.folder || fstat(file, &status)) return 0;
    if (!S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode)) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return is_below(path);
}

#define FAIL_IF(condition, kind)                                   \
    if ((condition) && next_action(kind) == FAIL) {                \
        errno = plan.error;                                        \
        return -1;                                                 \
    }

ssize_t write(int file, const void *bytes, size_t size) {
    ssize_t (*real)(int, const void *, size_t) = REAL(write);
    enum action action = is_own_file(file) ? next_action('w') : NONE;
    if (action == NONE) return real(file, bytes, size);
    if (action == SHORT) return real(file, bytes, size > 1 ? size / 2 : size);
    if ((action == KILL || plan.half) && size > 1 && real(file, bytes, size / 2) < 0) return -1;
    if (action == KILL) raise(SIGKILL);
    errno = plan.error;
    return -1;
}

// Writes only the first part that is not empty: a caller must be able to cope with that.
ssize_t writev(int file, const struct iovec *parts, int parts_count) {
    int first = 0;
    while (first < parts_count && parts[first].iov_len == 0) first++;
    if (!is_own_file(file) || first == parts_count) return REAL(writev)(file, parts, parts_count);
    return write(file, parts[first].iov_base, parts[first].iov_len);
}

int open64(const char *path, int flags, ...) {
    mode_t mode = 0;
    if (flags & (O_CREAT | O_TMPFILE)) {
        va_list rest;
        va_start(rest, flags);
        mode = va_arg(rest, mode_t);
        va_end(rest);
    }
    FAIL_IF((flags & (O_WRONLY | O_RDWR)) && is_below(path), 'o')
    return REAL(open64)(path, flags, mode);
}

int fsync(int file) {
    FAIL_IF(is_own_file(file), 's')
    return REAL(fsync)(file);
}

int fdatasync(int file) {
    FAIL_IF(is_own_file(file), 's')
    return REAL(fdatasync)(file);
}

int ftruncate64(int file, off64_t size) {
    FAIL_IF(is_own_file(file), 't')
    return REAL(ftruncate64)(file, size);
}

int rename(const char *from, const char *to) {
    FAIL_IF(is_below(to), 'r')
    return REAL(rename)(from, to);
}

int unlink(const char *path) {
    FAIL_IF(is_below(path), 'u')
    return REAL(unlink)(path);
}

int rmdir(const char *path) {
    FAIL_IF(is_below(path), 'u')
    return REAL(rmdir)(path);
}

int mkdir(const char *path, mode_t mode) {
    FAIL_IF(is_below(path), 'm')
    return REAL(mkdir)(path, mode);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    static unsigned long readings;
    int result = REAL(clock_gettime)(clock, now);
    if (!plan.clock_offset) return result;
    long thousandths = plan.clock_jumps ? (long)(draw(__sync_add_and_fetch(&readings, 1)) % 2001) - 1000 : 1000;
    now->tv_sec += plan.clock_offset / 1000 * thousandths;
    return result;
}
