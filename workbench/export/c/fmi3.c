/* FMI 3.0 for co-simulation over one Core. What is not part of it answers with an error. */
#include "fmi3Functions.h"

#include <stdlib.h>
#include <string.h>

#include "core.h"

typedef struct {
    Core core;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback say;
    int logging;
} Instance;

#define CORE (&((Instance *)instance)->core)
#define STATUS(call) ((fmi3Status)(call))

static void say(void *who, int status, const char *category, const char *message) {
    Instance *m = (Instance *)who;
    if (m->say && (m->logging || status >= ERROR)) m->say(m->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)n, (void)categories;
    ((Instance *)instance)->logging = on;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    Instance *m;
    (void)resources, (void)visible, (void)event_mode, (void)early, (void)required, (void)n, (void)update;
    if (!name || !token || strcmp(token, MODEL_TOKEN) != 0) {
        if (log) log(environment, fmi3Error, "logStatusError", "the instantiation token is not that of this model");
        return NULL;
    }
    m = (Instance *)calloc(1, sizeof *m);
    if (!m) return NULL;
    m->environment = environment;
    m->say = log;
    m->logging = logging;
    m->core.log = say;
    m->core.who = m;
    core_reset(&m->core);
    return m;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    (void)tolerance_defined, (void)tolerance;
    return STATUS(core_enter(CORE, start, stop_defined, stop));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { return STATUS(core_exit(CORE)); }
fmi3Status fmi3EnterStepMode(fmi3Instance instance) { (void)instance; return fmi3OK; }

fmi3Status fmi3Terminate(fmi3Instance instance) {
    CORE->now.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    core_reset(CORE);
    return fmi3OK;
}

#define WORSE(worst, status) ((status) > (worst) ? (status) : (worst))

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, fmi3Float64 values[], size_t nv) {
    int worst = OK;
    if (nv != n) return STATUS(core_say(CORE, ERROR, "%zu values for %zu variables, expected as many", nv, n));
    for (size_t i = 0; i < n; i++) { int s = core_get(CORE, refs[i], TYPE_REAL, &values[i]); worst = WORSE(worst, s); }
    return STATUS(worst);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, const fmi3Float64 values[], size_t nv) {
    int worst = OK;
    if (nv != n) return STATUS(core_say(CORE, ERROR, "%zu values for %zu variables, expected as many", nv, n));
    for (size_t i = 0; i < n; i++) { int s = core_set(CORE, refs[i], TYPE_REAL, values[i]); worst = WORSE(worst, s); }
    return STATUS(worst);
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, fmi3Boolean values[], size_t nv) {
    int worst = OK;
    double value = 0.0;
    if (nv != n) return STATUS(core_say(CORE, ERROR, "%zu values for %zu variables, expected as many", nv, n));
    for (size_t i = 0; i < n; i++) {
        int s = core_get(CORE, refs[i], TYPE_BOOLEAN, &value);
        values[i] = value != 0.0;
        worst = WORSE(worst, s);
    }
    return STATUS(worst);
}

fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, const fmi3Boolean values[], size_t nv) {
    int worst = OK;
    if (nv != n) return STATUS(core_say(CORE, ERROR, "%zu values for %zu variables, expected as many", nv, n));
    for (size_t i = 0; i < n; i++) { int s = core_set(CORE, refs[i], TYPE_BOOLEAN, values[i] ? 1.0 : 0.0); worst = WORSE(worst, s); }
    return STATUS(worst);
}

/* Reading none of a type that the model has not is no error. */
#define NO_VARIABLES(function, type)                                                                                     \
    fmi3Status function(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, type values[], size_t nv) {   \
        (void)refs, (void)values, (void)nv;                                                                              \
        return n == 0 ? fmi3OK : STATUS(core_say(CORE, ERROR, "the model has no variables of the type of " #function)); \
    }
NO_VARIABLES(fmi3GetFloat32, fmi3Float32)
NO_VARIABLES(fmi3GetInt8, fmi3Int8)
NO_VARIABLES(fmi3GetUInt8, fmi3UInt8)
NO_VARIABLES(fmi3GetInt16, fmi3Int16)
NO_VARIABLES(fmi3GetUInt16, fmi3UInt16)
NO_VARIABLES(fmi3GetInt32, fmi3Int32)
NO_VARIABLES(fmi3GetUInt32, fmi3UInt32)
NO_VARIABLES(fmi3GetInt64, fmi3Int64)
NO_VARIABLES(fmi3GetUInt64, fmi3UInt64)
NO_VARIABLES(fmi3GetString, fmi3String)
NO_VARIABLES(fmi3SetFloat32, const fmi3Float32)
NO_VARIABLES(fmi3SetInt8, const fmi3Int8)
NO_VARIABLES(fmi3SetUInt8, const fmi3UInt8)
NO_VARIABLES(fmi3SetInt16, const fmi3Int16)
NO_VARIABLES(fmi3SetUInt16, const fmi3UInt16)
NO_VARIABLES(fmi3SetInt32, const fmi3Int32)
NO_VARIABLES(fmi3SetUInt32, const fmi3UInt32)
NO_VARIABLES(fmi3SetInt64, const fmi3Int64)
NO_VARIABLES(fmi3SetUInt64, const fmi3UInt64)
NO_VARIABLES(fmi3SetString, const fmi3String)

#define NOT_PART_OF_IT(what) return STATUS(core_say(CORE, ERROR, what " is not part of this model"))

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, size_t sizes[], fmi3Binary values[], size_t nv) {
    (void)refs, (void)sizes, (void)values, (void)nv;
    if (n == 0) return fmi3OK;
    NOT_PART_OF_IT("a binary variable");
}
fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, const size_t sizes[], const fmi3Binary values[], size_t nv) {
    (void)refs, (void)sizes, (void)values, (void)nv;
    if (n == 0) return fmi3OK;
    NOT_PART_OF_IT("a binary variable");
}
fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, fmi3Clock values[]) {
    (void)refs, (void)values;
    if (n == 0) return fmi3OK;
    NOT_PART_OF_IT("a clock");
}
fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, const fmi3Clock values[]) {
    (void)refs, (void)values;
    if (n == 0) return fmi3OK;
    NOT_PART_OF_IT("a clock");
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    if (!*state) *state = malloc(sizeof(State));
    if (!*state) return STATUS(core_say(CORE, ERROR, "there is no memory for a stored state"));
    memcpy(*state, &CORE->now, sizeof(State));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) { return STATUS(core_restore(CORE, (const State *)state)); }
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    (void)instance;
    if (state) { free(*state); *state = NULL; }
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    (void)instance, (void)state;
    *size = sizeof MODEL_TOKEN + sizeof(State);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size != sizeof MODEL_TOKEN + sizeof(State))
        return STATUS(core_say(CORE, ERROR, "%zu bytes for a stored state, expected %zu", size, sizeof MODEL_TOKEN + sizeof(State)));
    memcpy(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN);
    memcpy(bytes + sizeof MODEL_TOKEN, state, sizeof(State));
    return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    if (size != sizeof MODEL_TOKEN + sizeof(State) || memcmp(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0)
        return STATUS(core_say(CORE, ERROR, "the bytes are no stored state of this model"));
    if (!*state) *state = malloc(sizeof(State));
    if (!*state) return STATUS(core_say(CORE, ERROR, "there is no memory for a stored state"));
    memcpy(*state, bytes + sizeof MODEL_TOKEN, sizeof(State));
    return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n,
                                        const fmi3ValueReference knowns[], size_t k, const fmi3Float64 seed[], size_t ns,
                                        fmi3Float64 sensitivity[], size_t nr) {
    if (ns != k || nr != n) return STATUS(core_say(CORE, ERROR, "seed and sensitivity have to be as long as knowns and unknowns"));
    return STATUS(core_derivative(CORE, unknowns, n, knowns, k, seed, sensitivity, 0));
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n,
                                    const fmi3ValueReference knowns[], size_t k, const fmi3Float64 seed[], size_t ns,
                                    fmi3Float64 sensitivity[], size_t nr) {
    if (ns != n || nr != k) return STATUS(core_say(CORE, ERROR, "seed and sensitivity have to be as long as unknowns and knowns"));
    return STATUS(core_derivative(CORE, unknowns, n, knowns, k, seed, sensitivity, 1));
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 from, fmi3Float64 length, fmi3Boolean no_return, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    int status = core_step(CORE, from, length);
    (void)no_return;
    *event = fmi3False;
    *terminate = fmi3False;
    *early = fmi3False;
    *last = CORE->now.time;
    return STATUS(status);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    if (log) log(environment, fmi3Error, "logStatusError", "model exchange is not part of this model; it is for co-simulation");
    return NULL;
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                               fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    if (log) log(environment, fmi3Error, "logStatusError", "scheduled execution is not part of this model; it is for co-simulation");
    return NULL;
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference r, size_t *n) {
    (void)r, (void)n;
    NOT_PART_OF_IT("a list of dependencies");
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference d, size_t a[], fmi3ValueReference i[], size_t b[],
                                       fmi3DependencyKind kinds[], size_t n) {
    (void)d, (void)a, (void)i, (void)b, (void)kinds, (void)n;
    NOT_PART_OF_IT("a list of dependencies");
}
fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference refs[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t nv) {
    (void)refs, (void)n, (void)orders, (void)values, (void)nv;
    NOT_PART_OF_IT("a derivative of an output by time");
}
fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time) {
    (void)clock, (void)time;
    NOT_PART_OF_IT("a clock");
}
fmi3Status fmi3EnterEventMode(fmi3Instance instance) { NOT_PART_OF_IT("the event mode"); }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) { NOT_PART_OF_IT("a structural parameter"); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) { NOT_PART_OF_IT("a structural parameter"); }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) { NOT_PART_OF_IT("the event mode"); }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *c, fmi3Boolean *d, fmi3Boolean *e,
                                    fmi3Float64 *f) {
    (void)a, (void)b, (void)c, (void)d, (void)e, (void)f;
    NOT_PART_OF_IT("the event mode");
}
#define NO_INTERVAL(function, ...) fmi3Status function(fmi3Instance instance, const fmi3ValueReference r[], size_t n, __VA_ARGS__)
NO_INTERVAL(fmi3GetIntervalDecimal, fmi3Float64 a[], fmi3IntervalQualifier q[]) { (void)r, (void)n, (void)a, (void)q; NOT_PART_OF_IT("a clock"); }
NO_INTERVAL(fmi3GetIntervalFraction, fmi3UInt64 a[], fmi3UInt64 b[], fmi3IntervalQualifier q[]) { (void)r, (void)n, (void)a, (void)b, (void)q; NOT_PART_OF_IT("a clock"); }
NO_INTERVAL(fmi3GetShiftDecimal, fmi3Float64 a[]) { (void)r, (void)n, (void)a; NOT_PART_OF_IT("a clock"); }
NO_INTERVAL(fmi3GetShiftFraction, fmi3UInt64 a[], fmi3UInt64 b[]) { (void)r, (void)n, (void)a, (void)b; NOT_PART_OF_IT("a clock"); }
NO_INTERVAL(fmi3SetIntervalDecimal, const fmi3Float64 a[]) { (void)r, (void)n, (void)a; NOT_PART_OF_IT("a clock"); }
NO_INTERVAL(fmi3SetIntervalFraction, const fmi3UInt64 a[], const fmi3UInt64 b[]) { (void)r, (void)n, (void)a, (void)b; NOT_PART_OF_IT("a clock"); }
NO_INTERVAL(fmi3SetShiftDecimal, const fmi3Float64 a[]) { (void)r, (void)n, (void)a; NOT_PART_OF_IT("a clock"); }
NO_INTERVAL(fmi3SetShiftFraction, const fmi3UInt64 a[], const fmi3UInt64 b[]) { (void)r, (void)n, (void)a, (void)b; NOT_PART_OF_IT("a clock"); }

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) { NOT_PART_OF_IT("model exchange"); }
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *c) {
    (void)a, (void)b, (void)c;
    NOT_PART_OF_IT("model exchange");
}
fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) { (void)time; NOT_PART_OF_IT("model exchange"); }
#define NO_STATES(function, ...) fmi3Status function(fmi3Instance instance, __VA_ARGS__)
NO_STATES(fmi3SetContinuousStates, const fmi3Float64 x[], size_t n) { (void)x, (void)n; NOT_PART_OF_IT("model exchange"); }
NO_STATES(fmi3GetContinuousStateDerivatives, fmi3Float64 x[], size_t n) { (void)x, (void)n; NOT_PART_OF_IT("model exchange"); }
NO_STATES(fmi3GetEventIndicators, fmi3Float64 x[], size_t n) { (void)x, (void)n; NOT_PART_OF_IT("model exchange"); }
NO_STATES(fmi3GetContinuousStates, fmi3Float64 x[], size_t n) { (void)x, (void)n; NOT_PART_OF_IT("model exchange"); }
NO_STATES(fmi3GetNominalsOfContinuousStates, fmi3Float64 x[], size_t n) { (void)x, (void)n; NOT_PART_OF_IT("model exchange"); }
NO_STATES(fmi3GetNumberOfEventIndicators, size_t *n) { (void)n; NOT_PART_OF_IT("model exchange"); }
NO_STATES(fmi3GetNumberOfContinuousStates, size_t *n) { (void)n; NOT_PART_OF_IT("model exchange"); }
