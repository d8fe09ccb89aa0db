fn main() {
    cd_formats::atomic::outlive_size_limit();
    std::process::exit(cd_pre::run(std::env::args_os()))
}
