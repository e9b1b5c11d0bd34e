//! Has the linker make an image that can lie anywhere.

fn main() {
    qemu_virt_image::link();
}
