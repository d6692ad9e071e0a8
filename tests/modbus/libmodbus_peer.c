/* An independent client: every function code that libmodbus has, one line of result each. */
#include <errno.h>
#include <modbus.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static void show_bits(const char *what, int n, const uint8_t *bits)
{
    printf("%s %d", what, n);
    for (int i = 0; i < n; i++)
        printf(" %d", bits[i]);
    printf("\n");
}

static void show_words(const char *what, int n, const uint16_t *words)
{
    printf("%s %d", what, n);
    for (int i = 0; i < n; i++)
        printf(" %04x", words[i]);
    printf("\n");
}

int main(int argc, char **argv)
{
    uint8_t on_off[11] = {1, 0, 1, 1, 0, 0, 1, 0, 1, 1, 1};
    uint8_t bits[MODBUS_MAX_READ_BITS] = {0};
    uint16_t sent[3] = {0x1111, 0x2222, 0x3333};
    uint16_t words[MODBUS_MAX_READ_REGISTERS] = {0};
    int n;

    if (argc != 2)
        return 2;
    modbus_t *peer = modbus_new_tcp("127.0.0.1", atoi(argv[1]));
    if (peer == NULL || modbus_connect(peer) != 0)
        return 3;

    printf("write_bit %d\n", modbus_write_bit(peer, 2, 1));
    printf("write_bits %d\n", modbus_write_bits(peer, 5, 11, on_off));
    n = modbus_read_bits(peer, 0, 17, bits);
    show_bits("read_bits", n, bits);
    n = modbus_read_input_bits(peer, 3, 9, bits);
    show_bits("read_input_bits", n, bits);
    printf("write_register %d\n", modbus_write_register(peer, 10, 0x0012));
    printf("mask_write %d\n", modbus_mask_write_register(peer, 10, 0x00f2, 0x0025));
    printf("write_registers %d\n", modbus_write_registers(peer, 11, 3, sent));
    n = modbus_read_registers(peer, 10, 4, words);
    show_words("read_registers", n, words);
    n = modbus_read_input_registers(peer, 0, 2, words);
    show_words("read_input_registers", n, words);
    n = modbus_write_and_read_registers(peer, 12, 2, sent, 10, 4, words);
    show_words("write_and_read", n, words);
    printf("largest %d %d\n", modbus_read_bits(peer, 0, MODBUS_MAX_READ_BITS, bits),
           modbus_read_registers(peer, 0, MODBUS_MAX_READ_REGISTERS, words));
    n = modbus_read_registers(peer, 9000, 1, words);
    printf("unmapped %d %s\n", n, modbus_strerror(errno));

    modbus_close(peer);
    modbus_free(peer);
    return 0;
}
