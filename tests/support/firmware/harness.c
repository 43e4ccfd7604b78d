/* Drives examples/firmware's controller: commands on stdin, one line each; answers on stdout.
 *   state MS p(3) xyzw(4) v(3) gyro(3)   the stabilizer's step: prints the command it gets
 *   packet HEX                           what the app channel received
 *   think                                a control step of the app
 *   observe                              the observation that the next `think` will see */
#include <stdio.h>
#include <stdlib.h>
#include "dronecombat_controller.c"

int critical;
static int asked;
static setpoint_t given;

void controllerPidInit(void) {}
bool controllerPidTest(void) { return true; }
void controllerPid(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                   const state_t *state, const stabilizerStep_t step)
{
    (void)sensors, (void)state, (void)step;
    control->controlMode = controlModeLegacy;
    given = *setpoint;
    ++asked;
}
TickType_t xTaskGetTickCount(void) { return 0; }
void vTaskDelayUntil(TickType_t *wake, TickType_t period) { *wake += period; }
size_t appchannelReceiveDataPacket(void *buffer, size_t length, int timeout)
{
    (void)buffer, (void)length, (void)timeout;
    return 0;
}

static void stabilize(void)
{
    state_t state = {0};
    sensorData_t sensors = {0};
    setpoint_t setpoint = {0};
    control_t control = {0};
    unsigned step;
    if (scanf("%u %f %f %f %f %f %f %f %f %f %f %f %f %f", &step, &state.position.x, &state.position.y,
              &state.position.z, &state.attitudeQuaternion.x, &state.attitudeQuaternion.y,
              &state.attitudeQuaternion.z, &state.attitudeQuaternion.w, &state.velocity.x, &state.velocity.y,
              &state.velocity.z, &sensors.gyro.x, &sensors.gyro.y, &sensors.gyro.z) != 14) exit(2);
    setpoint.thrust = -1.0f; /* the commander's */
    asked = 0;
    controllerOutOfTree(&control, &setpoint, &sensors, &state, step);
    if (asked && given.thrust < 0.0f) {
        printf("stock\n");
    } else if (asked) {
        printf("rates %.9g %.9g %.9g %.9g\n", (double)given.thrust, (double)given.attitudeRate.roll,
               (double)given.attitudeRate.pitch, (double)given.attitudeRate.yaw);
    } else {
        const float *numbers = control.normalizedForces; /* or thrust and torques, in their place */
        printf("%s %.9g %.9g %.9g %.9g\n", control.controlMode == controlModeForce ? "forces" : "torques",
               (double)numbers[0], (double)numbers[1], (double)numbers[2], (double)numbers[3]);
    }
}

int main(void)
{
    char word[80];
    controllerOutOfTreeInit();
    printf("test %d\n", controllerOutOfTreeTest());
    while (scanf("%79s", word) == 1) {
        if (!strcmp(word, "state")) stabilize();
        else if (!strcmp(word, "think")) think();
        else if (!strcmp(word, "observe")) {
            float seen[DRONECOMBAT_OBSERVATION_SIZE];
            observe(&shared.own, &shared.other, shared.target, seen);
            for (int i = 0; i < DRONECOMBAT_OBSERVATION_SIZE; ++i) printf("%.9g ", (double)seen[i]);
            printf("\n");
        } else if (!strcmp(word, "packet") && scanf("%79s", word) == 1) {
            packet_t packet;
            unsigned char *bytes = (unsigned char *)&packet;
            const size_t size = strlen(word) / 2;
            for (size_t i = 0; i < size && i < sizeof packet; ++i) {
                const char pair[3] = {word[2 * i], word[2 * i + 1], 0};
                bytes[i] = (unsigned char)strtol(pair, NULL, 16);
            }
            receive(&packet, size);
        } else return 3;
        if (critical) return 4;
    }
    return 0;
}
