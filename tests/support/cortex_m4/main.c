/* The exported policy on an emulated Cortex-M4: prints the self-test, actions for the observations in
 * observations.h, and the instructions of a call, all as numbers in decimal; by semihosting. */
#include <stdint.h>
#include <string.h>
#include "policy.h"
#include "observations.h" /* test_observations[TESTS * size] */

#define SYSTICK ((volatile uint32_t *)0xE000E010)
#define CPACR (*(volatile uint32_t *)0xE000ED88)
#define NS_A_TICK 40u /* of the board's clock of 25 MHz; under -icount an instruction is 1 ns */

static uint32_t semihosting(uint32_t operation, uintptr_t argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register uintptr_t r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void print(uint32_t number)
{
    char text[12], *at = text + 11;
    *at = 0;
    *--at = '\n';
    do *--at = (char)('0' + number % 10); while (number /= 10);
    semihosting(0x04, (uintptr_t)at); /* SYS_WRITE0 */
}

static uint32_t bits(float value)
{
    uint32_t word;
    memcpy(&word, &value, sizeof word);
    return word;
}

static void run(void)
{
    float action[DRONECOMBAT_ACTION_SIZE];
    print(bits(dronecombat_self_test()));
    for (int test = 0; test < TESTS; ++test) {
        dronecombat_policy(test_observations + test * DRONECOMBAT_OBSERVATION_SIZE, action);
        for (int i = 0; i < DRONECOMBAT_ACTION_SIZE; ++i) print(bits(action[i]));
    }
    SYSTICK[1] = 0x00FFFFFF; /* reload */
    SYSTICK[2] = 0;
    SYSTICK[0] = 5; /* on, the core's clock */
    const uint32_t before = SYSTICK[2];
    dronecombat_policy(test_observations, action);
    const uint32_t after = SYSTICK[2];
    print(((before - after) & 0x00FFFFFF) * NS_A_TICK);
    semihosting(0x18, 0x20026); /* SYS_EXIT, ADP_Stopped_ApplicationExit */
}

void reset(void)
{
    CPACR |= 0xFu << 20; /* the FPU on */
    __asm__ volatile("dsb; isb");
    run();
    for (;;) {}
}

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))0x20400000, reset,
};
