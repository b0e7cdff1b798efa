/* A speed controller on the other end of UDP: a whole client in C.  cc client.c -o client; ./client PORT HOLD_NM STEPS
   It hoists at 10 rad/s: torque = hold + 40 (10 - speed), one command for every state. */
#include <arpa/inet.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#pragma pack(push, 1)
struct command { char magic[4]; uint32_t byte_order, sequence, flags; double torque_nm; char token[16]; };
struct state {
    char magic[4];
    uint32_t byte_order, sequence, echo, flags, skipped_steps;
    double time_s, torque_nm, speed_motor, angle_motor, height, speed_carriage, acceleration, tension_drum, tension_dead,
        tension_min, force_guide, payload_kg, skipped_s;
};
#pragma pack(pop)

int main(int count, char **words) {
    if (count != 4) return fprintf(stderr, "client PORT HOLD_NM STEPS\n"), 2;
    int line = socket(AF_INET, SOCK_DGRAM, 0), got = 0;
    struct timeval patience = {2, 0};
    struct sockaddr_in plant = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(words[1]))};
    double hold = atof(words[2]);
    struct command out = {.magic = {'W', 'B', 'C', '2'}, .byte_order = 0x01020304, .torque_nm = hold};
    struct state in = {0};
    inet_pton(AF_INET, "127.0.0.1", &plant.sin_addr);
    setsockopt(line, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    for (int k = 0; k < atoi(words[3]); k++) {
        out.sequence = (uint32_t)k;
        sendto(line, &out, sizeof out, 0, (struct sockaddr *)&plant, sizeof plant);
        if (recv(line, &in, sizeof in, 0) != (ssize_t)sizeof in || memcmp(in.magic, "WBS2", 4)) break;
        out.torque_nm = hold + 40.0 * (10.0 - in.speed_motor);
        got++;
    }
    printf("%d %.6f %.6f %.6f %u\n", got, in.time_s, in.speed_motor, in.height, in.flags);
    close(line);
    return 0;
}
