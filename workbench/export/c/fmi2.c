/* FMI 2.0 for co-simulation over one Core. */
#include "fmi2Functions.h"

#include <stdlib.h>
#include <string.h>

#include "core.h"

typedef struct {
    Core core;
    const fmi2CallbackFunctions *callbacks;
    char name[200];
    int logging;
} Instance;

#define CORE (&((Instance *)instance)->core)
#define STATUS(call) ((fmi2Status)(call))
#define WORSE(worst, status) ((status) > (worst) ? (status) : (worst))

static void say(void *who, int status, const char *category, const char *message) {
    Instance *m = (Instance *)who;
    if (m->callbacks && m->callbacks->logger && (m->logging || status >= ERROR))
        m->callbacks->logger(m->callbacks->componentEnvironment, m->name, (fmi2Status)status, category, "%s", message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component instance, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)n, (void)categories;
    ((Instance *)instance)->logging = on;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Instance *m;
    const char *wrong = type != fmi2CoSimulation ? "model exchange is not part of this model; it is for co-simulation"
                        : !guid || strcmp(guid, MODEL_TOKEN) != 0 ? "the GUID is not that of this model" : NULL;
    (void)resources, (void)visible;
    if (wrong || !name) {
        if (wrong && callbacks && callbacks->logger)
            callbacks->logger(callbacks->componentEnvironment, name ? name : "", fmi2Error, "logStatusError", "%s", wrong);
        return NULL;
    }
    m = (Instance *)calloc(1, sizeof *m);
    if (!m) return NULL;
    strncpy(m->name, name, sizeof m->name - 1);
    m->callbacks = callbacks;
    m->logging = logging;
    m->core.log = say;
    m->core.who = m;
    core_reset(&m->core);
    return m;
}

void fmi2FreeInstance(fmi2Component instance) { free(instance); }

fmi2Status fmi2SetupExperiment(fmi2Component instance, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    (void)tolerance_defined, (void)tolerance;
    if (CORE->now.phase != INSTANTIATED) return STATUS(core_say(CORE, ERROR, "the experiment is set up before the initialization"));
    if (stop_defined && !(stop > start))
        return STATUS(core_say(CORE, ERROR, "the stop time %g does not lie after the start time %g", stop, start));
    CORE->now.start_time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component instance) { return STATUS(core_enter(CORE, CORE->now.start_time, 0, 0.0)); }
fmi2Status fmi2ExitInitializationMode(fmi2Component instance) { return STATUS(core_exit(CORE)); }

fmi2Status fmi2Terminate(fmi2Component instance) {
    CORE->now.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component instance) {
    core_reset(CORE);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference refs[], size_t n, fmi2Real values[]) {
    int worst = OK;
    for (size_t i = 0; i < n; i++) { int s = core_get(CORE, refs[i], TYPE_REAL, &values[i]); worst = WORSE(worst, s); }
    return STATUS(worst);
}
fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference refs[], size_t n, const fmi2Real values[]) {
    int worst = OK;
    for (size_t i = 0; i < n; i++) { int s = core_set(CORE, refs[i], TYPE_REAL, values[i]); worst = WORSE(worst, s); }
    return STATUS(worst);
}
fmi2Status fmi2GetBoolean(fmi2Component instance, const fmi2ValueReference refs[], size_t n, fmi2Boolean values[]) {
    int worst = OK;
    double value = 0.0;
    for (size_t i = 0; i < n; i++) {
        int s = core_get(CORE, refs[i], TYPE_BOOLEAN, &value);
        values[i] = value != 0.0;
        worst = WORSE(worst, s);
    }
    return STATUS(worst);
}
fmi2Status fmi2SetBoolean(fmi2Component instance, const fmi2ValueReference refs[], size_t n, const fmi2Boolean values[]) {
    int worst = OK;
    for (size_t i = 0; i < n; i++) { int s = core_set(CORE, refs[i], TYPE_BOOLEAN, values[i] ? 1.0 : 0.0); worst = WORSE(worst, s); }
    return STATUS(worst);
}

/* Reading none of a type that the model has not is no error. */
#define NO_VARIABLES(function, type)                                                                                     \
    fmi2Status function(fmi2Component instance, const fmi2ValueReference refs[], size_t n, type values[]) {             \
        (void)refs, (void)values;                                                                                        \
        return n == 0 ? fmi2OK : STATUS(core_say(CORE, ERROR, "the model has no variables of the type of " #function)); \
    }
NO_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_VARIABLES(fmi2GetString, fmi2String)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_VARIABLES(fmi2SetString, const fmi2String)

fmi2Status fmi2GetFMUstate(fmi2Component instance, fmi2FMUstate *state) {
    if (!*state) *state = malloc(sizeof(State));
    if (!*state) return STATUS(core_say(CORE, ERROR, "there is no memory for a stored state"));
    memcpy(*state, &CORE->now, sizeof(State));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component instance, fmi2FMUstate state) { return STATUS(core_restore(CORE, (const State *)state)); }
fmi2Status fmi2FreeFMUstate(fmi2Component instance, fmi2FMUstate *state) {
    (void)instance;
    if (state) { free(*state); *state = NULL; }
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component instance, fmi2FMUstate state, size_t *size) {
    (void)instance, (void)state;
    *size = sizeof MODEL_TOKEN + sizeof(State);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component instance, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size != sizeof MODEL_TOKEN + sizeof(State))
        return STATUS(core_say(CORE, ERROR, "%zu bytes for a stored state, expected %zu", size, sizeof MODEL_TOKEN + sizeof(State)));
    memcpy(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN);
    memcpy(bytes + sizeof MODEL_TOKEN, state, sizeof(State));
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component instance, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof MODEL_TOKEN + sizeof(State) || memcmp(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0)
        return STATUS(core_say(CORE, ERROR, "the bytes are no stored state of this model"));
    if (!*state) *state = malloc(sizeof(State));
    if (!*state) return STATUS(core_say(CORE, ERROR, "there is no memory for a stored state"));
    memcpy(*state, bytes + sizeof MODEL_TOKEN, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component instance, const fmi2ValueReference unknowns[], size_t n,
                                        const fmi2ValueReference knowns[], size_t k, const fmi2Real seed[], fmi2Real sensitivity[]) {
    return STATUS(core_derivative(CORE, unknowns, n, knowns, k, seed, sensitivity, 0));
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component instance, const fmi2ValueReference refs[], size_t n, const fmi2Integer orders[],
                                       const fmi2Real values[]) {
    int worst = OK;
    for (size_t i = 0; i < n; i++) { int s = core_rate(CORE, refs[i], orders[i], values[i]); worst = WORSE(worst, s); }
    return STATUS(worst);
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component instance, const fmi2ValueReference refs[], size_t n, const fmi2Integer orders[],
                                        fmi2Real values[]) {
    (void)refs, (void)orders, (void)values;
    return n == 0 ? fmi2OK : STATUS(core_say(CORE, ERROR, "a derivative of an output by time is not part of this model"));
}

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real from, fmi2Real length, fmi2Boolean no_return) {
    (void)no_return;
    return STATUS(core_step(CORE, from, length));
}
fmi2Status fmi2CancelStep(fmi2Component instance) { return STATUS(core_say(CORE, ERROR, "a step is done when it returns; there is none to cancel")); }

fmi2Status fmi2GetStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Status *value) {
    (void)kind, (void)value;
    return STATUS(core_say(CORE, DISCARD, "a step is done when it returns; it has no status"));
}
fmi2Status fmi2GetRealStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return STATUS(core_say(CORE, DISCARD, "only the last successful time is known as a number"));
    *value = CORE->now.time;
    return fmi2OK;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind, (void)value;
    return STATUS(core_say(CORE, DISCARD, "a step is done when it returns; it has no status"));
}
fmi2Status fmi2GetBooleanStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (kind != fmi2Terminated) return STATUS(core_say(CORE, DISCARD, "a step is done when it returns; it has no status"));
    *value = fmi2False;
    return fmi2OK;
}
fmi2Status fmi2GetStringStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2String *value) {
    (void)kind;
    *value = "";
    return STATUS(core_say(CORE, DISCARD, "a step is done when it returns; it has no status"));
}
