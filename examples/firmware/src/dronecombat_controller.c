/* An out-of-tree controller of the Crazyflie firmware that flies an exported policy. NEVER FLOWN: read
 * docs/flight.md first.
 *
 * The policy takes about 2 ms, and the stabilizer calls its controller every millisecond. So the
 * policy runs in the app's task, once a control step, on the newest state; the controller applies
 * the newest action, or hands over to the stock PID controller: without permission, on stale data,
 * outside the fence, or on a number that is not finite.
 *
 * From the ground, by the app channel, little-endian: OPPONENT packets (at least every 100 ms; `fly`
 * is the dead-man switch: 1 while a person holds it) and a TARGET packet before the flight. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "FreeRTOS.h"
#include "app.h"
#include "app_channel.h"
#include "controller.h"
#include "controller_pid.h"
#include "task.h"

#define DRONECOMBAT_BUFFERS static /* the app alone calls the policy */
#include "policy.h"

#if DRONECOMBAT_ACTUATION == DRONECOMBAT_WRENCH
#error "an ideal wrench, which no rotors give: train with sim.actuation = rotors, mixed or ctbr"
#endif
#if !DRONECOMBAT_WORLD
#error "this controller writes the observation `world`: train with game.observation = world"
#endif

/* Yours to set: where it may fly, in m and m/s, and how old data may be, in ms. */
#define FENCE_XY 2.0f
#define FENCE_LOW 0.3f
#define FENCE_HIGH 2.0f
#define FENCE_SPEED 3.0f
#define MAX_PACKET_AGE 150u
#define MAX_ACTION_AGE ((uint32_t)(3000.0f * DRONECOMBAT_CONTROL_DT))

#define RADIANS 0.017453292519943295f
enum { OPPONENT = 1, TARGET = 2 };

typedef struct {
    float position[3];   /* m, world */
    float quaternion[4]; /* wxyz, body to world */
    float velocity[3];   /* m/s, world */
    float rate[3];       /* rad/s, body */
} rigid_t;

typedef struct __attribute__((packed)) {
    uint8_t kind;
    uint8_t fly;           /* of OPPONENT: the dead-man switch */
    int16_t position[3];   /* mm */
    int16_t velocity[3];   /* mm/s */
    int16_t quaternion[4]; /* wxyz, 1/32767 */
    int16_t rate[3];       /* 0.01 rad/s */
} packet_t;                /* 28 bytes: an app channel's packet holds 31 */

static struct {
    rigid_t own, other;
    float target[3], action[DRONECOMBAT_ACTION_SIZE];
    uint32_t now, packet_at, action_at; /* ms, of the stabilizer */
    bool fly, seen, targeted, acted, barred;
} shared;

static void inBody(const float *q, const float *v, float *out)
{
    /* R(q)^T v, by v + 2 w (v x u) + 2 u x (u x v), u the vector part */
    const float a[3] = {v[1] * q[3] - v[2] * q[2], v[2] * q[1] - v[0] * q[3], v[0] * q[2] - v[1] * q[1]};
    const float b[3] = {a[1] * q[3] - a[2] * q[2], a[2] * q[1] - a[0] * q[3], a[0] * q[2] - a[1] * q[1]};
    for (int i = 0; i < 3; ++i) out[i] = v[i] + 2.0f * (q[0] * a[i] + b[i]);
}

static float *put(float *to, const float *from, int count)
{
    memcpy(to, from, (size_t)count * sizeof *to);
    return to + count;
}

/* The layout `world`: p_d q_d p_a q_a p_t v_d w_d v_a w_a g_d g_a; velocities and gravity in each body. */
static void observe(const rigid_t *own, const rigid_t *other, const float *target, float *out)
{
    static const float down[3] = {0.0f, 0.0f, -1.0f};
    const rigid_t *drones[2] = {DRONECOMBAT_ROLE ? other : own, DRONECOMBAT_ROLE ? own : other};
    float vector[3];
    for (int i = 0; i < 2; ++i) {
        out = put(out, drones[i]->position, 3);
        out = put(out, drones[i]->quaternion, 4);
    }
    out = put(out, target, 3);
    for (int i = 0; i < 2; ++i) {
        inBody(drones[i]->quaternion, drones[i]->velocity, vector);
        out = put(out, vector, 3);
        out = put(out, drones[i]->rate, 3);
    }
    for (int i = 0; i < 2; ++i) {
        inBody(drones[i]->quaternion, down, vector);
        out = put(out, vector, 3);
    }
}

static bool allFinite(const float *numbers, int count)
{
    for (int i = 0; i < count; ++i)
        if (!isfinite(numbers[i])) return false;
    return true;
}

/* The firmware's estimate in the game's units: gyro deg/s, quaternion xyzw. Of q and -q the one near
 * level: in training a fight begins level with w = 1. */
static rigid_t ownState(const state_t *state, const sensorData_t *sensors)
{
    const float sign = state->attitudeQuaternion.w < 0.0f ? -1.0f : 1.0f;
    const rigid_t own = {
        {state->position.x, state->position.y, state->position.z},
        {sign * state->attitudeQuaternion.w, sign * state->attitudeQuaternion.x,
         sign * state->attitudeQuaternion.y, sign * state->attitudeQuaternion.z},
        {state->velocity.x, state->velocity.y, state->velocity.z},
        {RADIANS * sensors->gyro.x, RADIANS * sensors->gyro.y, RADIANS * sensors->gyro.z},
    };
    return own;
}

static bool insideFence(const rigid_t *own)
{
    const float *p = own->position, *v = own->velocity;
    const float speed = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    return fabsf(p[0]) <= FENCE_XY && fabsf(p[1]) <= FENCE_XY && p[2] >= FENCE_LOW && p[2] <= FENCE_HIGH &&
           speed <= FENCE_SPEED && allFinite(own->quaternion, 4) && allFinite(own->rate, 3);
}

static void receive(const packet_t *packet, size_t size)
{
    taskENTER_CRITICAL();
    if (packet->kind == OPPONENT && size >= sizeof *packet) {
        for (int i = 0; i < 3; ++i) {
            shared.other.position[i] = 0.001f * packet->position[i];
            shared.other.velocity[i] = 0.001f * packet->velocity[i];
            shared.other.rate[i] = 0.01f * packet->rate[i];
        }
        float square = 0.0f;
        for (int i = 0; i < 4; ++i) square += (float)packet->quaternion[i] * packet->quaternion[i];
        const float length = packet->quaternion[0] < 0 ? -sqrtf(square) : sqrtf(square);
        for (int i = 0; i < 4; ++i) shared.other.quaternion[i] = packet->quaternion[i] / length;
        shared.seen = square > 0.0f;
        shared.packet_at = shared.now;
        shared.fly = packet->fly == 1;
        if (!shared.fly) shared.barred = false; /* let go and pressed anew: it may fly again */
    } else if (packet->kind == TARGET && size >= 8) {
        for (int i = 0; i < 3; ++i) shared.target[i] = 0.001f * packet->position[i];
        shared.targeted = true;
    }
    taskEXIT_CRITICAL();
}

/* One control step of the app's task: the policy on the newest state. */
static void think(void)
{
    float seen[DRONECOMBAT_OBSERVATION_SIZE], action[DRONECOMBAT_ACTION_SIZE];
    taskENTER_CRITICAL();
    const bool ready = shared.seen && shared.targeted;
    const rigid_t own = shared.own, other = shared.other;
    float target[3];
    put(target, shared.target, 3);
    const uint32_t now = shared.now;
    taskEXIT_CRITICAL();
    if (!ready) return;
    observe(&own, &other, target, seen);
    const bool sane = allFinite(seen, DRONECOMBAT_OBSERVATION_SIZE);
    if (sane) dronecombat_policy(seen, action);
    taskENTER_CRITICAL();
    if (sane && allFinite(action, DRONECOMBAT_ACTION_SIZE)) {
        put(shared.action, action, DRONECOMBAT_ACTION_SIZE);
        shared.action_at = now;
        shared.acted = true;
    } else {
        shared.barred = true;
    }
    taskEXIT_CRITICAL();
}

void appMain(void)
{
    packet_t packet;
    size_t size;
    TickType_t wake = xTaskGetTickCount();
    for (;;) {
        vTaskDelayUntil(&wake, M2T((uint32_t)(1000.0f * DRONECOMBAT_CONTROL_DT + 0.5f)));
        while ((size = appchannelReceiveDataPacket(&packet, sizeof packet, 0)) > 0) receive(&packet, size);
        think();
    }
}

static float between(float least, float most, float number)
{
    return least + (most - least) * (number + 1.0f) / 2.0f;
}

/* `action` in [-1, 1] as the firmware's command. */
static void apply(const float *action, control_t *control, const sensorData_t *sensors, const state_t *state,
                  const stabilizerStep_t step)
{
#if DRONECOMBAT_ACTUATION == DRONECOMBAT_ROTORS /* rotors: M1 to M4 are front right, back right, back left, front left */
    (void)sensors, (void)state, (void)step;
    control->controlMode = controlModeForce;
    for (int i = 0; i < STABILIZER_NR_OF_MOTORS; ++i)
        control->normalizedForces[i] =
            between(DRONECOMBAT_MIN_THRUST / DRONECOMBAT_MAX_THRUST, 1.0f, action[i]);
#elif DRONECOMBAT_ACTUATION == DRONECOMBAT_CTBR /* ctbr: through the firmware's own rate loop, whose pitch is turned round */
    setpoint_t rates;
    memset(&rates, 0, sizeof rates);
    rates.mode.roll = rates.mode.pitch = rates.mode.yaw = modeVelocity;
    rates.attitudeRate.roll = DRONECOMBAT_MAX_RATE_X * action[1] / RADIANS;
    rates.attitudeRate.pitch = -DRONECOMBAT_MAX_RATE_Y * action[2] / RADIANS;
    rates.attitudeRate.yaw = DRONECOMBAT_MAX_RATE_Z * action[3] / RADIANS;
    rates.thrust = (float)UINT16_MAX * between(DRONECOMBAT_MIN_THRUST / DRONECOMBAT_MAX_THRUST, 1.0f, action[0]);
    controllerPid(control, &rates, sensors, state, step);
#else /* mixed */
    (void)sensors, (void)state, (void)step;
    control->controlMode = controlModeForceTorque;
    control->thrustSi = between(0.0f, DRONECOMBAT_FULL_THRUST, action[0]);
    for (int i = 0; i < 3; ++i) control->torque[i] = DRONECOMBAT_FULL_MOMENT * action[1 + i];
#endif
}

void controllerOutOfTreeInit(void)
{
    memset(&shared, 0, sizeof shared);
    controllerPidInit();
}

bool controllerOutOfTreeTest(void)
{
    return controllerPidTest() && dronecombat_self_test() <= DRONECOMBAT_TOLERANCE;
}

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t stabilizerStep)
{
    float action[DRONECOMBAT_ACTION_SIZE];
    const rigid_t own = ownState(state, sensors);
    taskENTER_CRITICAL();
    shared.own = own;
    shared.now = stabilizerStep; /* of 1000 Hz */
    const bool fresh = shared.acted && shared.now - shared.packet_at <= MAX_PACKET_AGE &&
                       shared.now - shared.action_at <= MAX_ACTION_AGE;
    const bool wanted = shared.fly && fresh;
    if (wanted && !insideFence(&own)) shared.barred = true;
    const bool flies = wanted && !shared.barred;
    put(action, shared.action, DRONECOMBAT_ACTION_SIZE);
    taskEXIT_CRITICAL();
    if (flies) {
        apply(action, control, sensors, state, stabilizerStep);
    } else {
        controllerPid(control, setpoint, sensors, state, stabilizerStep);
    }
}
