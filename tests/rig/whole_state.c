/* For linux.uml on a processor with AMX, by LD_PRELOAD.
 *
 * User-Mode Linux 6.1 keeps a process's extended state (AVX and so on) in 2,696 bytes, and writes as many back by ptrace. A kernel takes
 * back no less than all of it (xstateregs_set in arch/x86/kernel/fpu/regset.c), which with AMX's tiles is 11,008: UML panics at its start.
 * Here what is missing is added: no tile is in use, which is so in a guest, whose kernel lets no process ask for them.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

enum { USED = 512, TILES = 3 << 17 }; /* where the state says which parts of it are used, and AMX's two */

typedef long (*Ptrace)(enum __ptrace_request, pid_t, void *, void *);

long ptrace(enum __ptrace_request request, ...)
{
    static Ptrace real;
    static char whole[1 << 16];
    static size_t size; /* of all state; 0 is not known */
    va_list given;
    va_start(given, request);
    const pid_t process = va_arg(given, pid_t);
    void *const which = va_arg(given, void *);
    struct iovec *const part = va_arg(given, void *);
    va_end(given);
    if (real == NULL)
        real = (Ptrace)dlsym(RTLD_NEXT, "ptrace");
    if (request != PTRACE_SETREGSET || (uintptr_t)which != NT_X86_XSTATE)
        return real(request, process, which, part);
    struct iovec all = {whole, sizeof whole};
    if (size == 0) {
        if (real(PTRACE_GETREGSET, process, which, &all) < 0)
            return -1;
        size = all.iov_len;
    }
    if (part->iov_len >= size)
        return real(request, process, which, part);
    memcpy(whole, part->iov_base, part->iov_len);
    memset(whole + part->iov_len, 0, size - part->iov_len);
    uint64_t used;
    memcpy(&used, whole + USED, sizeof used);
    used &= ~(uint64_t)TILES;
    memcpy(whole + USED, &used, sizeof used);
    all.iov_len = size;
    return real(request, process, which, &all);
}
