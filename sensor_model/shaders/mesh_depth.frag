#version 330 core
// Depth is all that is wanted.
void main()
{
}
