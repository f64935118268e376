// A running pair of nodes with its coordinator, in virtual time, and a stranger who hears their
// messages and publishes forged ones. Whatever is sent, no process may crash, the run makes
// progress or ends within two seconds, and it ends with the bits of an undisturbed run or with an
// error that says why. (Where the network loses messages, a forged one may stand in for a lost one;
// then nobody can tell.)
#ifndef PM_TESTS_FORGED_PAIR_H
#define PM_TESTS_FORGED_PAIR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

// Two scenes: their steps have eight rounds, and one round.
enum { FORGED_SCENES = 2, FORGED_CHANNELS = 14 };

// A value that replaces the number in a message: a limit, or a change of the present number.
enum { FORGED_LIMITS = 11, FORGED_VALUES = FORGED_LIMITS + 3 };

typedef enum forged_end {
    FORGED_SAME_BITS,  // the run is complete, with the bits of an undisturbed run
    FORGED_ERROR,      // the run ended with an error that says why
    FORGED_REPLACED,   // complete with other bits, where the network also lost messages
    FORGED_OTHER_BITS, // complete with other bits, where it lost none
    FORGED_NO_WORDS,   // the run ended with an error that says nothing
    FORGED_STALL,      // no progress for two seconds
    FORGED_ENDS
} forged_end;

// The counts of what happened in a number of runs. The caller initialises it with zeros.
typedef struct forged_figures {
    long runs, messages;   // messages: forged ones that were published into a run
    long end[FORGED_ENDS]; // number of runs with each end
    long lonely;           // runs that ended before a node had joined: it leaves after its patience
    double longest;        // s, virtual: the longest time without progress
} forged_figures;

// A forged message: at the beginning of one turn of a run, the last message on a channel with one
// number changed.
typedef struct forgery {
    int scene, turn, channel;
    size_t at, size; // bytes: where the number begins, and 1, 4 or 8
    int value;       // one of FORGED_VALUES
} forgery;

// Returns the number of bytes of the last message on a channel before a turn of an undisturbed run;
// 0: there is none, or the run is over.
size_t forged_pair_message_size(int scene, int turn, int channel);

// Runs a pair with a single forgery, and adds the outcome to `figures`. Publishes nothing, and adds
// nothing, if the message ends before the number or the change leaves it as it is.
void forged_pair_run_one(const forgery *forgery, forged_figures *figures);

// Runs a pair with up to eight forgeries that `data` [size] describes: when, which of the messages
// that were heard last, and what is changed in it. Some of these runs lose messages as well. Adds
// the outcome to `figures`.
void forged_pair_run_many(const uint8_t *data, size_t size, forged_figures *figures);

// Returns the number of runs that ended as no run may.
long forged_pair_failures(const forged_figures *figures);

// Prints the figures, and how often runs ended with each error (# stands for a word with a digit).
void forged_pair_print(FILE *file, const forged_figures *figures);

#endif
