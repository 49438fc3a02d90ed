// SPDX-License-Identifier: Apache-2.0
#include "imu_chip.h"

#include <cstring>

namespace sinew {
namespace {

constexpr uint8_t kReadBit = 0x80;
constexpr uint32_t kSilentUs = 20000;  // after so long without a sample the chip counts as dead
constexpr uint32_t kResetMs = 100, kSettleMs = 30;

namespace mpu9250 {
constexpr uint8_t kSampleDivider = 0x19, kConfig = 0x1A, kGyroConfig = 0x1B, kAccelConfig = 0x1C, kAccelConfig2 = 0x1D;
constexpr uint8_t kInterruptEnable = 0x38, kInterruptStatus = 0x3A, kReadings = 0x3B;
constexpr uint8_t kUserControl = 0x6A, kPower1 = 0x6B, kPower2 = 0x6C, kWhoAmI = 0x75;
constexpr uint16_t kPeriodUs = 1000;
}  // namespace mpu9250

namespace icm20648 {
constexpr uint8_t kBank = 0x7F, kBank0 = 0x00, kBank2 = 0x20;
constexpr uint8_t kWhoAmI = 0x00, kUserControl = 0x03, kPower1 = 0x06, kPower2 = 0x07;
constexpr uint8_t kInterruptEnable1 = 0x11, kInterruptStatus1 = 0x1A, kReadings = 0x2D;
// In bank 2.
constexpr uint8_t kGyroDivider = 0x00, kGyroConfig1 = 0x01, kAccelDivider1 = 0x10, kAccelDivider2 = 0x11, kAccelConfig = 0x14;
constexpr uint16_t kPeriodUs = 889;
}  // namespace icm20648

// Bits that both chips have in common.
constexpr uint8_t kReset = 0x80, kClockPll = 0x01, kNoI2c = 0x10, kDataReady = 0x01;

int16_t big_endian(const uint8_t* bytes) { return static_cast<int16_t>(bytes[0] << 8 | bytes[1]); }

}  // namespace

Chip::Chip(Node& node, Clock& clock, Spi& spi, Board& board) : node_(node), clock_(clock), spi_(spi), board_(board) {}

bool Chip::begin() {
    kind_ = Kind::kAbsent;
    if (read(mpu9250::kWhoAmI) == kMpu9250) {
        kind_ = Kind::kMpu;
        set_up_mpu9250();
    } else {
        write(icm20648::kBank, icm20648::kBank0);
        if (read(icm20648::kWhoAmI) == kIcm20648) {
            kind_ = Kind::kIcm;
            set_up_icm20648();
        }
    }
    works_ = kind_ != Kind::kAbsent;
    taken_us_ = clock_.micros();
    node_.report_chip(works_);
    return works_;
}

void Chip::wake(uint8_t power1, uint8_t power2, uint8_t user_control) {
    write(power1, kReset);
    board_.wait_ms(kResetMs);
    write(power1, kClockPll);
    write(user_control, kNoI2c);
    write(power2, 0);
    board_.wait_ms(kSettleMs);
}

void Chip::set_up_mpu9250() {
    using namespace mpu9250;
    wake(kPower1, kPower2, kUserControl);
    write(kSampleDivider, 0);
    write(kConfig, 3);             // 41 Hz, 1 kHz
    write(kGyroConfig, 3 << 3);    // 2000 deg/s
    write(kAccelConfig, 0);        // 2 g
    write(kAccelConfig2, 3);       // 44.8 Hz, 1 kHz
    write(kInterruptEnable, kDataReady);
    period_us_ = kPeriodUs;
    node_.describe_chip(kMpu9250, kMpu9250DelayUs, kPeriodUs);
}

void Chip::set_up_icm20648() {
    using namespace icm20648;
    wake(kPower1, kPower2, kUserControl);
    write(kBank, kBank2);
    write(kGyroDivider, 0);
    write(kGyroConfig1, 3 << 3 | 3 << 1 | 1);  // 51.2 Hz, 2000 deg/s
    write(kAccelDivider1, 0);
    write(kAccelDivider2, 0);
    write(kAccelConfig, 3 << 3 | 1);           // 50.4 Hz, 2 g
    write(kBank, kBank0);
    write(kInterruptEnable1, kDataReady);
    period_us_ = kPeriodUs;
    node_.describe_chip(kIcm20648, kIcm20648DelayUs, kPeriodUs);
}

void Chip::poll() {
    if (kind_ == Kind::kAbsent) return;
    const uint32_t now_us = clock_.micros();
    const uint32_t since_us = now_us - taken_us_;
    // After a fresh sample there is none sooner, and to ask would only take time; after a late one the next may be near.
    if (was_fresh_ && since_us < period_us_ * 3 / 4) return;
    const bool is_ready =
        read(kind_ == Kind::kMpu ? mpu9250::kInterruptStatus : icm20648::kInterruptStatus1) & kDataReady;
    if (is_ready) return take(now_us);
    empty_us_ = now_us;
    if (works_ && since_us > kSilentUs) {
        works_ = false;
        node_.report_chip(false);
    }
}

void Chip::take(uint32_t now_us) {
    // MPU-9250: acceleration, temperature, rates; ICM-20648: acceleration, rates, temperature.
    const bool is_mpu = kind_ == Kind::kMpu;
    uint8_t bytes[15] = {static_cast<uint8_t>(kReadBit | (is_mpu ? mpu9250::kReadings : icm20648::kReadings))};
    spi_.exchange(bytes, sizeof bytes);
    const uint8_t* acceleration = bytes + 1;
    const uint8_t* gyro = bytes + (is_mpu ? 9 : 7);
    Sample sample{};
    for (size_t axis = 0; axis < 3; ++axis) {
        sample.acceleration[axis] = big_endian(acceleration + 2 * axis);
        sample.gyro[axis] = big_endian(gyro + 2 * axis);
    }
    taken_us_ = clock_.micros();  // who was held up between looking and taking has not found the chip silent
    was_fresh_ = now_us - empty_us_ < period_us_ / 4;
    node_.take(sample, now_us, was_fresh_);
    if (!works_) {
        works_ = true;
        node_.report_chip(true);
    }
}

uint8_t Chip::read(uint8_t place) {
    uint8_t bytes[] = {static_cast<uint8_t>(kReadBit | place), 0};
    spi_.exchange(bytes, sizeof bytes);
    return bytes[1];
}

void Chip::write(uint8_t place, uint8_t value) {
    uint8_t bytes[] = {place, value};
    spi_.exchange(bytes, sizeof bytes);
}

}  // namespace sinew
