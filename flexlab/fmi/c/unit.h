/* A unit of flexlab: declarations that its files share. layout.h is generated for each scenario. */
#ifndef FLEXLAB_UNIT_H
#define FLEXLAB_UNIT_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "layout.h"

enum { DONE, REFUSED = 3 }; /* As fmi2OK, fmi3OK and fmi2Error, fmi3Error. */

enum { NUMBER, OWN, SHARED };        /* Kinds of words: flexlab/fmi/machine_code.py. */
enum { UNREACHABLE = 1, SINGULAR, NOT_A_NUMBER, BENT, OTHER_STEP = 100 }; /* flexlab/sim/advance.py. */

typedef struct Unit Unit;
typedef void (*Say)(Unit *unit, const char *sentence);

struct Unit {
    void *environment;
    void (*log)(void); /* The importer's own callback; NULL if it has none. */
    Say say;
    char *name;
    int64_t words[WORD_COUNT];            /* The kernel's arguments. */
    unsigned char memory[OWN_SIZE + 8];   /* First the state, then scratch arrays. */
};

/* Phases of an instance, named as in the standard. */
enum { INSTANTIATED, INITIALIZING, RUNNING, STOPPED, TERMINATED };
typedef struct { int64_t tick, level, phase; double time; } State; /* The beginning of an instance's memory. */

extern const unsigned char flexlab_data[];
extern const int64_t *const words, *const kinds; /* Of a new instance. */

static inline State *state_of(Unit *unit) { return (State *)unit->memory; }
static inline int64_t bits(double number) {
    int64_t word;
    memcpy(&word, &number, sizeof word);
    return word;
}
int64_t located(Unit *unit, int64_t kind, int64_t value);

/* In world.c or law.c: compute the outputs of the present instant; advance some ticks. Both return a fault code. */
int64_t look(Unit *unit);
int64_t go(Unit *unit, int64_t count);

Unit *unit_new(const char *name, const char *token, void *environment, void (*log)(void), Say say);
void unit_free(Unit *unit);
int unit_reset(Unit *unit);
int unit_set_up(Unit *unit, double start_time);
int unit_enter(Unit *unit);
int unit_exit(Unit *unit);
int unit_end(Unit *unit);
int unit_last_time(Unit *unit, double *value);
double unit_time(const Unit *unit);
int unit_step(Unit *unit, double time, double step, double *reached);
int unit_get(Unit *unit, const uint32_t references[], size_t count, double values[]);
int unit_set(Unit *unit, const uint32_t references[], size_t count, const double values[]);
int unit_refuse(Unit *unit, const char *sentence);
int unit_get_state(Unit *unit, void **state);
int unit_set_state(Unit *unit, const void *state);
int unit_free_state(Unit *unit, void **state);
int unit_state_size(Unit *unit, const void *state, size_t *size);
int unit_read_state(Unit *unit, const unsigned char bytes[], size_t size, void **state);
int unit_write_state(Unit *unit, const void *state, unsigned char bytes[], size_t size);

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
/* A function that the standard requires in every library and that this unit does not need. */
#define ABSENT(name) EXPORT int name(Unit *unit) { return unit_refuse(unit, "This unit does not offer " #name "."); }

#endif
