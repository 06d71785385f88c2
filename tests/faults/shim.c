/* Lets one chosen system call on files of a folder fail, for tests of failing disks.
 *
 * Preloaded into a process (LD_PRELOAD). `fault_arm(kind, number, error, folder)` arms it: the
 * number-th call of that kind on a file in the folder fails with `error`, and with `number` < 0
 * every call from the (-number)-th on. `fault_count()` returns how many calls there were.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { NONE, OPEN, WRITE, SYNC, RENAME, CLOSE, TRUNCATE };

static int armed = NONE, number = 0, error = 0, count = 0;
static char folder[PATH_MAX] = "";

void fault_arm(int kind, int which, int code, const char *where) {
  strncpy(folder, where, sizeof folder - 1);
  number = which, error = code, count = 0, armed = kind;
}

int fault_count(void) { return count; }

static int in_folder(const char *path) { return strncmp(path, folder, strlen(folder)) == 0; }

static int fails(int kind, const char *path, int handle) {
  if (kind != armed) return 0;
  char name[64], target[PATH_MAX];
  if (!path) {
    snprintf(name, sizeof name, "/proc/self/fd/%d", handle);
    ssize_t length = readlink(name, target, sizeof target - 1);
    if (length < 0) return 0;
    target[length] = 0;
    path = target;
  }
  if (!in_folder(path)) return 0;
  count++;
  if (number > 0 ? count != number : count < -number) return 0;
  errno = error;
  return 1;
}

#define REAL(type, name, ...) ((type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name))

ssize_t write(int h, const void *b, size_t n) {
  return fails(WRITE, 0, h) ? -1 : REAL(ssize_t, write, int, const void *, size_t)(h, b, n);
}
ssize_t pwrite(int h, const void *b, size_t n, off_t at) {
  return fails(WRITE, 0, h) ? -1
                            : REAL(ssize_t, pwrite, int, const void *, size_t, off_t)(h, b, n, at);
}
ssize_t pwrite64(int h, const void *b, size_t n, off64_t at) {
  return fails(WRITE, 0, h)
             ? -1
             : REAL(ssize_t, pwrite64, int, const void *, size_t, off64_t)(h, b, n, at);
}
ssize_t writev(int h, const struct iovec *v, int n) {
  return fails(WRITE, 0, h) ? -1 : REAL(ssize_t, writev, int, const struct iovec *, int)(h, v, n);
}
int fsync(int h) { return fails(SYNC, 0, h) ? -1 : REAL(int, fsync, int)(h); }
int fdatasync(int h) { return fails(SYNC, 0, h) ? -1 : REAL(int, fdatasync, int)(h); }
int ftruncate(int h, off_t n) {
  return fails(TRUNCATE, 0, h) ? -1 : REAL(int, ftruncate, int, off_t)(h, n);
}
int ftruncate64(int h, off64_t n) {
  return fails(TRUNCATE, 0, h) ? -1 : REAL(int, ftruncate64, int, off64_t)(h, n);
}
int rename(const char *from, const char *to) {
  return fails(RENAME, to, 0) ? -1 : REAL(int, rename, const char *, const char *)(from, to);
}
int close(int h) {
  if (fails(CLOSE, 0, h)) {
    REAL(int, close, int)(h); /* as Linux does: the handle is gone all the same */
    errno = error;
    return -1;
  }
  return REAL(int, close, int)(h);
}

#define OPENS(name)                                                  \
  int name(const char *path, int flags, ...) {                       \
    va_list more;                                                    \
    va_start(more, flags);                                           \
    int mode = va_arg(more, int);                                    \
    va_end(more);                                                    \
    if (fails(OPEN, path, 0)) return -1;                             \
    return REAL(int, name, const char *, int, ...)(path, flags, mode); \
  }
OPENS(open)
OPENS(open64)
