/* misbehaving.c: an FMU of FMI 2.0, dx/dt = u - x and y = x with a time event at 0.5, that misbehaves in one call.
 *
 * Its GUID says how and where: "{segfault@doStep}". In the calls "load" and "unload", where there is no GUID yet, the
 * environment variable MISBEHAVES says the same. What escapes ("{escape@doStep}") tells by y what it reached.
 */
#define _GNU_SOURCE /* usleep, feenableexcept */

#include <fcntl.h>
#include <fenv.h>
#include <locale.h>
#include <math.h>
#include <arpa/inet.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#if defined __x86_64__
#include <xmmintrin.h>
#endif

#include "fmi2Functions.h"

#define EVENT 0.5
#define BLOCK ((size_t)64 << 20)
#define MOST_BLOCKS 48 /* 3 GiB: enough for any limit, and not the end of the machine */
#define MOST_DESCRIPTORS 256
#define MOST_MAPPINGS 100000
#define MOST_THREADS 4 /* of each copy: thousands of calls shall not fill the machine */

enum { VR_U, VR_X, VR_DER_X, VR_Y, N_VARIABLES };

typedef struct {
    char what[32];
    char where[32];
    double time;
    double v[N_VARIABLES];
    int spoilt; /* values are not numbers any more */
    int endless;
    int reached; /* sum of what an escape reached */
} Model;

static volatile int *volatile nowhere;
static void *volatile hoard;

static void *go_on(void *unused)
{
    (void)unused;
    for (;;) {
        puts("misbehaving: a thread that was left behind");
        fflush(stdout);
        usleep(1000);
    }
    return NULL;
}

static void hog(void)
{
    for (int i = 0; i < MOST_BLOCKS; i++) {
        char *block = malloc(BLOCK);
        if (block != NULL) {
            memset(block, i + 1, BLOCK);
            hoard = block;
        }
    }
}

/* What reaches beyond the process: a bit each, as tests/test_confine.py names them. */
enum { WROTE = 1, SENT_TCP = 2, SENT_UDP = 4, CHILD_WROTE = 8, EMPTIED = 16, SIGNALLED = 32, OPENED_UP = 64, OWN = 128 };

static const char *place(const char *variable, const char *name)
{
    static char path[1024];
    snprintf(path, sizeof path, "%s/%s", getenv(variable), name);
    return path;
}

static int write_file(const char *path)
{
    FILE *file = fopen(path, "w");
    return file != NULL && fclose(file) == 0;
}

static int reach(int type)
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((unsigned short)atoi(getenv("ESCAPE_PORT")))};
    int end = socket(AF_INET, type, 0);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return end >= 0 && connect(end, (struct sockaddr *)&to, sizeof to) == 0;
}

static int child_writes(void)
{
    int status = 1;
    pid_t child = fork();
    if (child == 0) {
        _exit(!write_file(place("ESCAPE_HOME", "by_child")));
    }
    return child > 0 && waitpid(child, &status, 0) == child && status == 0;
}

static int escape(void)
{
    int reached = 0;
    reached |= write_file(place("ESCAPE_HOME", "written")) ? WROTE : 0;
    reached |= reach(SOCK_STREAM) ? SENT_TCP : 0;
    reached |= reach(SOCK_DGRAM) ? SENT_UDP : 0;
    reached |= child_writes() ? CHILD_WROTE : 0;
    reached |= truncate(place("ESCAPE_HOME", "precious"), 0) == 0 ? EMPTIED : 0;
    reached |= kill(getppid(), 0) == 0 ? SIGNALLED : 0;
    reached |= chmod(place("ESCAPE_HOME", "precious"), 0777) == 0 ? OPENED_UP : 0;
    reached |= write_file(place("TMPDIR", "own")) ? OWN : 0;
    return reached;
}

/* Round upwards where nobody reads: fegetround of x86 returns the word of its older arithmetic unit. */
static void round_up(void)
{
#if defined __x86_64__
    _mm_setcsr((_mm_getcsr() & ~0x6000U) | 0x4000U);
#else
    fesetround(FE_UPWARD);
#endif
}

/* Tiny numbers count as nothing, as with -ffast-math. */
static void flush_to_zero(void)
{
#if defined __x86_64__
    _mm_setcsr(_mm_getcsr() | 0x8040U);
#elif defined __aarch64__
    __asm__ volatile("msr fpcr, %0" : : "r"((unsigned long)1 << 24));
#endif
}

static void trap(void)
{
#ifdef __GLIBC__
    feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
#endif
}

static void lower(int what, rlim_t to)
{
    struct rlimit limit = {to, to};
    setrlimit(what, &limit);
}

static void use_up_mappings(void)
{
    for (int i = 0; i < MOST_MAPPINGS; i++) {
        const int rights = i % 2 ? PROT_READ : PROT_READ | PROT_WRITE; /* or the system would join them */
        if (mmap(NULL, 4096, rights, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) == MAP_FAILED) {
            return;
        }
    }
}

static void change(const char *what)
{
    sigset_t every;
    struct itimerval often = {{1000, 0}, {1000, 0}};
    if (strcmp(what, "arithmetic") == 0) {
        round_up();
    } else if (strcmp(what, "flush") == 0) {
        flush_to_zero();
    } else if (strcmp(what, "traps") == 0) {
        trap();
    } else if (strcmp(what, "comma") == 0) { /* a language with a decimal comma, where the machine has it */
        setlocale(LC_ALL, "de_DE.UTF-8");
    } else if (strcmp(what, "data") == 0) {
        lower(RLIMIT_DATA, 1 << 20);
    } else if (strcmp(what, "stack") == 0) {
        lower(RLIMIT_STACK, 1 << 20);
    } else if (strcmp(what, "size") == 0) {
        lower(RLIMIT_FSIZE, 1 << 20);
    } else if (strcmp(what, "space") == 0) {
        lower(RLIMIT_AS, 1 << 20);
    } else if (strcmp(what, "few") == 0) {
        lower(RLIMIT_NOFILE, 3);
    } else if (strcmp(what, "cpu") == 0) {
        lower(RLIMIT_CPU, 1);
    } else if (strcmp(what, "umask") == 0) {
        umask(0777);
    } else if (strcmp(what, "mask") == 0) {
        sigfillset(&every);
        sigprocmask(SIG_SETMASK, &every, NULL);
    } else if (strcmp(what, "handler") == 0) {
        signal(SIGUSR1, SIG_IGN);
    } else if (strcmp(what, "timer") == 0) {
        setitimer(ITIMER_REAL, &often, NULL);
    } else if (strcmp(what, "environment") == 0) {
        setenv("HOME", "/nowhere", 1);
    } else if (strcmp(what, "mappings") == 0) {
        use_up_mappings();
    } else if (strcmp(what, "fork") == 0) {
        signal(SIGCHLD, SIG_IGN);
        fork(); /* both go on */
    } else if (strcmp(what, "close") == 0) {
        for (int file = 3; file < MOST_DESCRIPTORS; file++) {
            close(file);
        }
    } else if (strcmp(what, "hangup") == 0) {
        _exit(119);
    }
}

static void do_it(const char *what, Model *model)
{
    if (strcmp(what, "segfault") == 0) {
        *nowhere = 1;
    } else if (strcmp(what, "abort") == 0) {
        abort();
    } else if (strcmp(what, "exit0") == 0) {
        exit(0);
    } else if (strcmp(what, "exit3") == 0) {
        exit(3);
    } else if (strcmp(what, "hang") == 0) {
        for (;;) { /* idle: an FMU that hangs at work is the one of hostile.c */
            usleep(100000);
        }
    } else if (strcmp(what, "nan") == 0 && model != NULL) {
        model->spoilt = 1;
    } else if (strcmp(what, "events") == 0 && model != NULL) {
        model->endless = 1;
    } else if (strcmp(what, "memory") == 0) {
        hog();
    } else if (strcmp(what, "stdout") == 0) {
        puts("misbehaving: \033[31ma line that nobody wants");
        fflush(stdout);
    } else if (strcmp(what, "descriptors") == 0) {
        for (int file = 0; file < MOST_DESCRIPTORS; file++) {
            if (write(file, "\1\2\3\4", 4) < 0) {
                continue;
            }
        }
    } else if (strcmp(what, "thread") == 0) {
        static int threads;
        pthread_t thread;
        if (threads < MOST_THREADS && pthread_create(&thread, NULL, go_on, NULL) == 0) {
            threads++;
        }
    } else if (strcmp(what, "escape") == 0 && model != NULL) {
        model->reached = escape();
    } else if (what[0] == '_') { /* changes its process, and goes on as if nothing had been */
        change(what + 1);
    } else if (strcmp(what, "rounding") == 0 && fesetround(FE_UPWARD) != 0) {
        return;
    } else if (strcmp(what, "files") == 0) {
        while (open("/dev/null", O_RDONLY) >= 0) {
            continue;
        }
    } else if (strcmp(what, "cwd") == 0 && chdir("/") != 0) {
        return;
    }
}

static void misbehave(Model *model, const char *where)
{
    if (strcmp(model->where, where) == 0) {
        do_it(model->what, model);
    }
}

/* FMI knows no negative status. */
static fmi2Status answer(const Model *model, const char *where)
{
    return strcmp(model->what, "negative") == 0 && strcmp(model->where, where) == 0 ? (fmi2Status)-1 : fmi2OK;
}

static void split(const char *text, char what[32], char where[32])
{
    what[0] = where[0] = '\0';
    if (sscanf(text, "{%31[^@]@%31[^}]}", what, where) != 2) {
        what[0] = where[0] = '\0';
    }
}

static void outside(const char *where)
{
    const char *asked = getenv("MISBEHAVES");
    char what[32], at[32];
    if (asked == NULL) {
        return;
    }
    split(asked, what, at);
    if (strcmp(at, where) == 0) {
        do_it(what, NULL);
    }
}

__attribute__((constructor)) static void loaded(void)
{
    outside("load");
}

__attribute__((destructor)) static void unloaded(void)
{
    outside("unload");
}

/* ---- life ---- */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c;
    (void)on;
    (void)n;
    (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name;
    (void)type;
    (void)location;
    (void)callbacks;
    (void)visible;
    (void)logging;
    Model *model = calloc(1, sizeof *model);
    if (model != NULL) {
        split(guid, model->what, model->where);
        model->v[VR_U] = 1.0;
        misbehave(model, "instantiate");
    }
    return model;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c != NULL) {
        misbehave(c, "freeInstance");
        free(c);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean controlled, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)controlled;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    ((Model *)c)->time = start;
    misbehave(c, "setupExperiment");
    return answer(c, "setupExperiment");
}

#define ONLY(function, where)                                                                                          \
    fmi2Status function(fmi2Component c)                                                                               \
    {                                                                                                                  \
        misbehave(c, where);                                                                                           \
        return answer(c, where);                                                                                       \
    }
ONLY(fmi2EnterInitializationMode, "enterInitialization")
ONLY(fmi2ExitInitializationMode, "exitInitialization")
ONLY(fmi2EnterEventMode, "enterEventMode")
ONLY(fmi2EnterContinuousTimeMode, "enterContinuousTime")
ONLY(fmi2Terminate, "terminate")
ONLY(fmi2Reset, "reset")

/* ---- values ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Model *model = c;
    misbehave(model, "getReal");
    model->v[VR_DER_X] = model->v[VR_U] - model->v[VR_X];
    model->v[VR_Y] = model->v[VR_X] + model->reached;
    for (size_t i = 0; i < n; i++) {
        value[i] = model->spoilt ? NAN : model->v[vr[i]];
    }
    return answer(c, "getReal");
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    misbehave(c, "setReal");
    for (size_t i = 0; i < n; i++) {
        ((Model *)c)->v[vr[i]] = value[i];
    }
    return answer(c, "setReal");
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    misbehave(c, "getFMUstate");
    if (*state == NULL) {
        *state = malloc(sizeof(Model));
    }
    if (*state == NULL) {
        return fmi2Error;
    }
    memcpy(*state, c, sizeof(Model));
    return answer(c, "getFMUstate");
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    memcpy(c, state, sizeof(Model));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* ---- Model Exchange ---- */

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    Model *model = c;
    misbehave(model, "newDiscreteStates");
    memset(info, 0, sizeof *info);
    info->newDiscreteStatesNeeded = model->endless ? fmi2True : fmi2False;
    info->nextEventTimeDefined = model->time < EVENT ? fmi2True : fmi2False;
    info->nextEventTime = EVENT;
    if (strcmp(model->what, "past") == 0 || strcmp(model->what, "never") == 0) {
        info->nextEventTimeDefined = fmi2True;
        info->nextEventTime = model->what[0] == 'p' ? model->time - 1.0 : NAN;
    }
    return answer(c, "newDiscreteStates");
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set, fmi2Boolean *event, fmi2Boolean *terminate)
{
    (void)no_set;
    misbehave(c, "completedIntegratorStep");
    *event = fmi2False;
    *terminate = fmi2False;
    return answer(c, "completedIntegratorStep");
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ((Model *)c)->time = time;
    misbehave(c, "setTime");
    return answer(c, "setTime");
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    (void)n;
    misbehave(c, "setContinuousStates");
    ((Model *)c)->v[VR_X] = x[0];
    return answer(c, "setContinuousStates");
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    (void)n;
    misbehave(c, "getContinuousStates");
    x[0] = ((Model *)c)->v[VR_X];
    return answer(c, "getContinuousStates");
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    Model *model = c;
    (void)n;
    misbehave(model, "getDerivatives");
    dx[0] = model->spoilt ? NAN : model->v[VR_U] - model->v[VR_X];
    return answer(c, "getDerivatives");
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n)
{
    for (size_t i = 0; i < n; i++) {
        z[i] = 1.0;
    }
    misbehave(c, "getEventIndicators");
    return answer(c, "getEventIndicators");
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n)
{
    (void)c;
    (void)n;
    nominal[0] = 1.0;
    return fmi2OK;
}

/* ---- Co-Simulation ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean no_set)
{
    Model *model = c;
    (void)no_set;
    misbehave(model, "doStep");
    model->v[VR_X] += model->reached ? 0.0 : size * (model->v[VR_U] - model->v[VR_X]);
    model->time = point + size;
    return answer(c, "doStep");
}
