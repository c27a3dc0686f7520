// torch's allocator of host memory, of which a part lies in the emulated device; and a guard for the device "cuda".
#include <c10/core/Allocator.h>
#include <c10/core/CPUAllocator.h>
#include <c10/core/impl/DeviceGuardImplInterface.h>
#include <cstdint>

extern "C" uint64_t emu_alloc(uint64_t size, uint64_t stream);
extern "C" void emu_give_up(uint64_t host_address);

namespace {
constexpr uint64_t kDelta = 0x080000000000ull;  // EMU_DELTA of device_runtime.h
constexpr uint8_t kBeforeOthers = 200;
thread_local int64_t stream_of_thread = -1;  // -1: memory of the host

void give_up(void* block) { emu_give_up(reinterpret_cast<uint64_t>(block)); }

struct DeviceAllocator final : c10::Allocator {
  c10::Allocator* host = nullptr;
  c10::DataPtr allocate(size_t size) override {
    if (stream_of_thread < 0 || !size) return host->allocate(size);
    uint64_t address = emu_alloc(size, stream_of_thread);
    TORCH_CHECK(address, "CUDA out of memory: the emulated device has no more addresses");
    void* block = reinterpret_cast<void*>(address + kDelta);
    return {block, block, &give_up, c10::Device(c10::DeviceType::CPU)};
  }
  void copy_data(void* to, const void* from, size_t size) const override { default_copy_data(to, from, size); }
};
DeviceAllocator allocator;

// Autograd asks for streams and events of its own; the device's are Python's.
struct Guard final : c10::impl::NoOpDeviceGuardImpl<c10::DeviceType::CUDA> {
  static c10::Device cuda() { return c10::Device(c10::DeviceType::CUDA, 0); }
  void record(void** event, const c10::Stream&, const c10::DeviceIndex, const c10::EventFlag) const override {
    *event = const_cast<Guard*>(this);
  }
  c10::Stream getStream(c10::Device) const noexcept override { return c10::Stream(c10::Stream::DEFAULT, cuda()); }
  c10::Stream getDefaultStream(c10::Device device) const override { return getStream(device); }
  c10::Stream getNewStream(c10::Device device, int) const override { return getStream(device); }
  c10::Stream exchangeStream(c10::Stream stream) const noexcept override { return stream; }
  c10::Device getDevice() const override { return cuda(); }
  c10::Device exchangeDevice(c10::Device) const override { return cuda(); }
  void block(void*, const c10::Stream&) const override {}
  bool queryEvent(void*) const override { return true; }
  void destroyEvent(void*, const c10::DeviceIndex) const noexcept override {}
  bool queryStream(const c10::Stream&) const override { return true; }
  void synchronizeStream(const c10::Stream&) const override {}
  void synchronizeEvent(void*) const override {}
};
Guard guard;
}  // namespace

extern "C" void emulated_install() {
  auto& slot = c10::impl::device_guard_impl_registry[static_cast<size_t>(c10::DeviceType::CUDA)];
  if (!slot.load()) slot.store(&guard);
  allocator.host = c10::GetCPUAllocator();
  c10::SetCPUAllocator(&allocator, kBeforeOthers);
}

// Where this thread's tensors are made from now on: a stream's handle, or -1 for the host. Returns what it was.
extern "C" int64_t emulated_allocate_in(int64_t stream) {
  int64_t before = stream_of_thread;
  stream_of_thread = stream;
  return before;
}
